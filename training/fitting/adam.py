"""Adam (Kingma and Ba, 2015) on named float32 arrays."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dfcgs_codec.array_types import AnyArray, Bool, Float32, Int64

_FIRST, _SECOND = 0.9, 0.999
#: as in 3DGS: gradients are tiny, and a larger one would slow faint Gaussians down
_EPSILON = np.float32(1e-15)


class Adam:
    """Changes the arrays in place; a rate is a number, or an array that broadcasts to its values."""

    def __init__(self, values: Mapping[str, Float32]) -> None:
        self.values = dict(values)
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

    def select(self, rows: Int64, fresh: Bool) -> None:
        """Go on with `rows` of every array, some more than once; those that are `fresh` without a past."""
        self.values = {name: array[rows] for name, array in self.values.items()}
        for past in (self._mean, self._square):
            for name, array in past.items():
                past[name] = array[rows]
                past[name][fresh] = 0.0

    def forget(self, name: str) -> None:
        """Let one array go on without a past."""
        self._mean[name][:] = 0.0
        self._square[name][:] = 0.0

    def arrays(self) -> dict[str, AnyArray]:
        """All that `from_arrays` needs."""
        kinds = {"value": self.values, "mean": self._mean, "square": self._square}
        found = {f"{kind}_{name}": array for kind, part in kinds.items() for name, array in part.items()}
        return {"steps": np.array(self.steps), **found}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, AnyArray]) -> Adam:
        """As it was when `arrays` were taken."""

        def part(kind: str) -> dict[str, Float32]:
            return {k.removeprefix(kind): v for k, v in arrays.items() if k.startswith(kind)}

        adam = cls(part("value_"))
        adam._mean, adam._square = part("mean_"), part("square_")
        adam.steps = int(arrays["steps"])
        return adam


def decayed(start: float, end: float, progress: float) -> float:
    """A rate that falls exponentially from `start` to `end` as `progress` goes from 0 to 1."""
    return float(start * (end / start) ** progress)
