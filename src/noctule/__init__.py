"""Noctule: an indoor flight stack for low-cost quadcopters, without motion capture."""

__version__ = "0.1.0"
