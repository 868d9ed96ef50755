"""I-frames, and births in P-frames (spec sections 11 and 13)."""
