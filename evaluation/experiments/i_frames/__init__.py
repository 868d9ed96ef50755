"""Experiments on I-frames alone."""
