"""P-frames of profile PAPER."""
