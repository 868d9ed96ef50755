"""Experiments on profile `paper`."""
