"""Columns of integers, and how symbols are coded (spec sections 10 and 11)."""
