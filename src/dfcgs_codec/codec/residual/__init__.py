"""What is left of a P-frame after motion (spec section 12)."""
