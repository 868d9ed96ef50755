"""A prior that knows nothing: all symbols are of one class. What recordings are first made with."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Integers
from dfcgs_codec.entropy.symbols import EXPLICIT_REACH
from dfcgs_codec.entropy.tables import FREQUENCY_BITS, NUM_SCALES, Shape, frequencies_from_weights
from dfcgs_codec.model.context_model import (
    CONTROL_WEIGHTS,
    NUM_CELLS,
    NUM_CLASSES,
    NUM_COLUMN_INPUTS,
    NUM_COMMON_INPUTS,
    NUM_CONTROL_COMMON,
    NUM_CONTROL_INPUTS,
    NUM_DENSITY_CLASSES,
    NUM_FLAG_CLASSES,
    NUM_FLAG_INPUTS,
)

Arrays = dict[str, Integers]
#: inputs of each network, common ones and others, and its classes
WIDTHS = {
    "flags": (NUM_COMMON_INPUTS, NUM_FLAG_INPUTS, NUM_FLAG_CLASSES),
    "columns": (NUM_COMMON_INPUTS, NUM_COLUMN_INPUTS, NUM_CLASSES),
    "control": (NUM_CONTROL_COMMON, NUM_CONTROL_INPUTS, NUM_CLASSES),
}
#: a Laplace distribution of sigma 2
_ANY_TABLE = Shape.LAPLACE * NUM_SCALES + 32


def untrained_arrays() -> Arrays:
    """The arrays of its file."""
    arrays: Arrays = {}
    for name, (common, others, classes) in WIDTHS.items():
        arrays[f"{name}.0.weight"] = np.zeros((1, common + others), np.int16)
        arrays[f"{name}.0.bias"] = np.array([classes // 2], np.int32)
        arrays[f"{name}.0.scale"] = np.array([0, classes - 1], np.int64)
    for name in ("columns", "control"):
        arrays[f"{name}.tables"] = np.full(NUM_CELLS, _ANY_TABLE, np.int16)
        arrays[f"{name}.frequencies"] = np.zeros((0, 2 * EXPLICIT_REACH + 1), np.int32)
    half = np.full((NUM_FLAG_CLASSES, 2), 1 << (FREQUENCY_BITS - 1), np.int32)
    flat = frequencies_from_weights(np.ones(NUM_DENSITY_CLASSES, np.int64)).astype(np.int32)
    arrays["flags.frequencies"] = half
    arrays["densities.frequencies"] = np.tile(flat, (NUM_DENSITY_CLASSES**2, 1))
    arrays["magnitudes.tables"] = np.full(2 * NUM_DENSITY_CLASSES, _ANY_TABLE, np.int16)
    arrays["control.weights"] = np.zeros(CONTROL_WEIGHTS, np.int16)
    return arrays
