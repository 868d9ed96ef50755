"""Adam (Kingma and Ba, 2015) on named float32 arrays."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]

_FIRST, _SECOND = 0.9, 0.999
#: as in 3DGS: gradients are tiny, and a larger one would slow faint Gaussians down
_EPSILON = np.float32(1e-15)


class Adam:
    """Changes the arrays in place; a rate is a number, or an array that broadcasts to its values."""

    def __init__(self, values: Mapping[str, Float32]) -> None:
        self.values = values
        self.steps = 0
        self._mean = {name: np.zeros_like(array) for name, array in values.items()}
        self._square = {name: np.zeros_like(array) for name, array in values.items()}

    def step(self, gradients: Mapping[str, Float32], rates: Mapping[str, float | Float32]) -> None:
        """One step down the gradients."""
        self.steps += 1
        correction = np.sqrt(1.0 - _SECOND**self.steps) / (1.0 - _FIRST**self.steps)
        for name, array in self.values.items():
            gradient, mean, square = gradients[name], self._mean[name], self._square[name]
            mean += np.float32(1.0 - _FIRST) * (gradient - mean)
            square += np.float32(1.0 - _SECOND) * (gradient * gradient - square)
            array -= np.float32(correction) * rates[name] * mean / (np.sqrt(square) + _EPSILON)


def decayed(start: float, end: float, progress: float) -> float:
    """A rate that falls exponentially from `start` to `end` as `progress` goes from 0 to 1."""
    return float(start * (end / start) ** progress)
