"""Training of the frozen prior of profile `main`: recordings of the codec at work -> networks and tables."""
