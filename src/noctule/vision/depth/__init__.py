"""Depth images to foreground, blobs and shapes."""
