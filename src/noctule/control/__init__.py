"""Errors to velocities: the servoing laws, the tasks, their hierarchy, and what bounds a command.

Plain functions and frozen dataclasses on numpy arrays. Nothing here reads a clock, a file or a device.
"""
