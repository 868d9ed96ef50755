"""Dense layers of integers, held in float64 so that BLAS does the work (spec annex B.3).

Sums stay below 2**53, which is asserted for the weights at hand: then float64 is exact, in any order of
summation and with any number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, Int16, Int64

#: inputs of a network lie within +- this, and so do activations but the last
ACTIVATION_LIMIT = (1 << 15) - 1
#: what leaves a network lies within +- this
OUTPUT_LIMIT = 1 << 22
#: negative activations are divided by 2**7
LEAK_BITS = 7
_EXACT = 1 << 53
_MAX_SHIFT = 40
#: rows at a time, so that activations stay in the cache
_ROWS = 4096


class LayerError(ValueError):
    """Weights that do not make a layer, or that could leave the range in which float64 is exact."""


@dataclass(frozen=True)
class Layer:
    """y = clip((W x + b) >> shift, +-limit), and y >> 7 where `leaky` and y < 0.

    `weight` (out, in) and `bias` (out,) are float64 arrays of integers; all shifts round down.
    """

    weight: Float64
    bias: Float64
    shift: int
    limit: int
    leaky: bool

    @staticmethod
    def of(weight: Int16, bias: Int64, scale: Int64) -> Layer:
        """From `weight` int16 (out, in), `bias` int64 (out,), `scale` int64: shift, limit, leaky."""
        fits = weight.ndim == 2 and bias.shape == weight.shape[:1] and scale.shape == (3,)
        if not fits or weight.dtype != np.int16 or bias.dtype != np.int64 or scale.dtype != np.int64:
            raise LayerError("the arrays of a layer do not fit each other")
        shift, limit, leaky = scale.tolist()
        if not (0 <= shift <= _MAX_SHIFT and 0 < limit <= OUTPUT_LIMIT and leaky in (0, 1)):
            raise LayerError(f"shift {shift}, limit {limit} or leaky {leaky} is out of range")
        return Layer(weight.astype(np.float64), bias.astype(np.float64), shift, limit, bool(leaky))

    def check(self, input_limit: int) -> None:
        """LayerError where inputs within +-`input_limit` could lead to a sum that is not exact."""
        bound = np.abs(self.weight).sum(axis=1) * input_limit + np.abs(self.bias)
        if bound.max() >= _EXACT:
            raise LayerError(f"a sum of {bound.max():.3g} is possible, 2**53 is the limit")

    def __call__(self, inputs: Float64) -> Float64:
        """Outputs (rows, out) of `inputs` (rows, in), both integers in float64."""
        values: Float64 = inputs @ self.weight.T
        values += self.bias
        values *= 2.0**-self.shift
        np.floor(values, out=values)
        np.clip(values, -self.limit, self.limit, out=values)
        if self.leaky:
            leaked = np.floor(values * 2.0**-LEAK_BITS)
            np.copyto(values, leaked, where=values < 0)
        return values


@dataclass(frozen=True)
class Network:
    """Layers one after the other."""

    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        limit, width = ACTIVATION_LIMIT, self.num_inputs
        for index, layer in enumerate(self.layers):
            if layer.weight.shape[1] != width:
                raise LayerError(f"layer {index} takes {layer.weight.shape[1]} values and is given {width}")
            layer.check(limit)
            limit, width = layer.limit, layer.weight.shape[0]
            if index + 1 < len(self.layers) and limit > ACTIVATION_LIMIT:
                raise LayerError(f"layer {index} lets {limit} pass, {ACTIVATION_LIMIT} is the limit")

    @property
    def num_inputs(self) -> int:
        """Values that it takes of each row."""
        return int(self.layers[0].weight.shape[1])

    @property
    def num_outputs(self) -> int:
        """Values that it gives for each row."""
        return int(self.layers[-1].weight.shape[0])

    def __call__(self, inputs: Int64) -> Int64:
        """Outputs int64 (rows, out) of `inputs` int64 (rows, in), which are clipped to 16 bits first."""
        result = np.empty((len(inputs), self.num_outputs), np.int64)
        for start in range(0, len(inputs), _ROWS):
            part = slice(start, start + _ROWS)
            values = np.clip(inputs[part], -ACTIVATION_LIMIT, ACTIVATION_LIMIT).astype(np.float64)
            for layer in self.layers:
                values = layer(values)
            result[part] = values
        return result
