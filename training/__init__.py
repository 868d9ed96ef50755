"""Training of the frozen model, and the scenes it is trained on; may import the codec, never the reverse."""
