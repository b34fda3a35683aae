"""Calibration of a depth camera that stands in the room: intrinsics, where it hangs, constant offsets."""
