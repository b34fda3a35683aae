"""Which blobs may be the drone: by area cubics, by a band of the surface seen, and by Hu's moments."""
