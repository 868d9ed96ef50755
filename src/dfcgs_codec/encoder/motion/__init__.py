"""Which motion a P-frame gets."""
