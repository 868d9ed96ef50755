"""Small models of random integers, for tests that need none that was trained."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Integers
from dfcgs_codec.model.latent_model import HYPER_REACH, NUM_LATENTS, WIDTHS, LatentModel

_HIDDEN = 24


def random_arrays(seed: int = 0, *, without: tuple[str, ...] = (), gain: int = 40) -> dict[str, Integers]:
    """The arrays of a model whose networks have one hidden layer."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, Integers] = {}
    for name, (inputs, outputs) in WIDTHS.items():
        if name in without:
            continue
        widths = (inputs, _HIDDEN, outputs)
        for index in range(2):
            weight = rng.integers(-gain, gain + 1, (widths[index + 1], widths[index]))
            limit = 1 << 22 if (name, index) == ("synthesis", 1) else (1 << 15) - 1
            arrays[f"{name}.{index}.weight"] = weight.astype(np.int16)
            arrays[f"{name}.{index}.bias"] = rng.integers(-2000, 2001, widths[index + 1])
            arrays[f"{name}.{index}.scale"] = np.array([8, limit, index == 0], np.int64)
    arrays["grid"] = rng.integers(-128, 128, (6, 4096, 4)).astype(np.int8)
    weights = rng.integers(1, 1000, (NUM_LATENTS, 2 * HYPER_REACH + 1)) ** 2
    shares = weights * ((1 << 24) - 63) // weights.sum(axis=1, keepdims=True) + 1
    shares[:, HYPER_REACH] += (1 << 24) - shares.sum(axis=1)
    arrays["hyper_frequencies"] = shares.astype(np.int32)
    return arrays


def random_model(model_id: str = "random", seed: int = 0, **choices: object) -> LatentModel:
    """A model of `random_arrays`."""
    return LatentModel.of_arrays(model_id, random_arrays(seed, **choices))  # type: ignore[arg-type]
