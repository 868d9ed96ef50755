"""Exact integer arithmetic: grids, orders, rotations."""
