"""The integer state of a frame, and what it says of visibility (spec sections 7 and 9)."""
