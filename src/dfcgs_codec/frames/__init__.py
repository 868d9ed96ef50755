"""Which files are the frames, and in which order."""
