"""What a manual flight in an otherwise empty room teaches: the detectors, and the drone's top view."""
