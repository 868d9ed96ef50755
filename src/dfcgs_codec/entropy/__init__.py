"""Entropy coding: frozen integer tables and the only user of constriction."""
