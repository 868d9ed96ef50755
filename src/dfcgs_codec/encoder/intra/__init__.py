"""What an encoder chooses for I-frames."""
