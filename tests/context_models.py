"""Priors of random integers, for tests that need none that was trained."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int32, Integers
from dfcgs_codec.entropy.symbols import EXPLICIT_REACH
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, frequencies_from_weights
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
    ContextModel,
)

_HIDDEN = 12
_NUM_TABLES = 9
#: inputs and classes of each network
WIDTHS = {
    "flags": (NUM_COMMON_INPUTS + NUM_FLAG_INPUTS, NUM_FLAG_CLASSES),
    "columns": (NUM_COMMON_INPUTS + NUM_COLUMN_INPUTS, NUM_CLASSES),
    "control": (NUM_CONTROL_COMMON + NUM_CONTROL_INPUTS, NUM_CLASSES),
}


def _frequencies(rng: np.random.Generator, rows: int, size: int) -> Int32:
    weights = rng.integers(1, 1000, (rows, size)) ** 2
    return np.array([frequencies_from_weights(row) for row in weights]).astype(np.int32)


def random_arrays(seed: int = 0) -> dict[str, Integers]:
    """The arrays of a model whose networks have one hidden layer and whose classes are all in use."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, Integers] = {}
    for name, (inputs, classes) in WIDTHS.items():
        for index, widths in enumerate(((inputs, _HIDDEN), (_HIDDEN, 1))):
            arrays[f"{name}.{index}.weight"] = rng.integers(-60, 61, widths[::-1]).astype(np.int16)
            arrays[f"{name}.{index}.bias"] = rng.integers(0, 4001, widths[1]).astype(np.int32)
            arrays[f"{name}.{index}.scale"] = np.array([(5, 1023), (10, classes - 1)][index], np.int64)
    for name in ("columns", "control"):
        scales = rng.integers(20, 75, NUM_CELLS) + NUM_SCALES * rng.integers(0, len(Shape), NUM_CELLS)
        own = rng.integers(0, 2, NUM_CELLS) > 0
        scales[own] = -1 - rng.integers(0, _NUM_TABLES, NUM_CELLS)[own]
        arrays[f"{name}.tables"] = scales.astype(np.int16)
        arrays[f"{name}.frequencies"] = _frequencies(rng, _NUM_TABLES, 2 * EXPLICIT_REACH + 1)
    arrays["flags.frequencies"] = _frequencies(rng, NUM_FLAG_CLASSES, 2)
    arrays["densities.frequencies"] = _frequencies(rng, NUM_DENSITY_CLASSES**2, NUM_DENSITY_CLASSES)
    arrays["magnitudes.tables"] = rng.integers(20, 40, 2 * NUM_DENSITY_CLASSES).astype(np.int16)
    arrays["control.weights"] = rng.integers(-200, 201, CONTROL_WEIGHTS).astype(np.int16)
    return arrays


def random_prior(model_id: str = "random-prior", seed: int = 0) -> ContextModel:
    """A model of `random_arrays`."""
    return ContextModel.of_arrays(model_id, random_arrays(seed))
