"""What of a P-frame's residual is coded, and how finely."""
