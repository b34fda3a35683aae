"""Measurements -> state: odometry, where a target image was taken, where a column stands."""
