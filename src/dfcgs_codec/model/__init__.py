"""Frozen networks in integer arithmetic, and their weights."""
