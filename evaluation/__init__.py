"""Evaluation of the codec against baselines."""
