"""P-frames of profile PAPER (spec section 16)."""
