"""What a decoder repeats: state, symbol walks, reconstruction."""
