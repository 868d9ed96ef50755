"""Formats of others that the codec is compared with."""
