"""P-frames of profile PAPER (spec annex B)."""
