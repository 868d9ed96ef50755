"""Bytes to syntax structures and back; no numpy arithmetic."""
