"""Bindings of the codec as records of the core."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.codec.motion.followers import Binding

BINDING = np.dtype([("rank", "u2", 4), ("weight", "u2", 4), ("effort", "i2", 5), ("choice", "u2")])


def packed(binding: Binding) -> np.ndarray:
    """Records (N,) of a binding."""
    records = np.zeros(len(binding.choice), BINDING)
    records["rank"], records["weight"] = binding.gathering.ranks.T, binding.gathering.weights.T
    records["effort"], records["choice"] = binding.efforts.T, binding.choice
    return records


def same(records: np.ndarray, binding: Binding) -> bool:
    """Whether the core has the same binding."""
    return np.array_equal(records, packed(binding))
