"""What only an encoder does: analysis and decisions."""
