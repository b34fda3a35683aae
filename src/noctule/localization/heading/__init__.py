"""Single-frame heading and pose of a blob: what the registration of the top view is compared with."""
