"""I-frames, and births in P-frames (spec section 11, spec annex A)."""
