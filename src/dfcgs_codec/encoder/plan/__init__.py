"""What a user asks for, and what is settled before the first frame is coded."""
