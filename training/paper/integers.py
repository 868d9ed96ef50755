"""The integer layers of the codec, evaluated in int64 by numpy and in float64 by torch: the same integers.

acc = weight @ x + bias;  v = clip(acc >> shift, -limit, limit);  where leaky, v < 0 becomes v >> 7
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from dfcgs_codec.array_types import AnyArray, Int16, Int32, Int64
from training.paper.inputs import INPUT_BITS
from training.paper.nets import (
    GRID_BITS,
    LEAKY_SHIFT,
    SHAPES,
    PaperModel,
    Shape,
)

#: float64 holds integers below this exactly
EXACT = 1 << 53
#: z from -31 to 31; the ends are escapes
HYPER_REACH = 31
FREQUENCY_BITS = 24


@dataclass(frozen=True, eq=False)
class IntegerLayer:
    """A dense layer: `weight` (out, in), `bias` (out,), and what happens to the sum."""

    weight: Int16
    bias: Int64
    shift: int
    limit: int
    leaky: bool

    def largest_sum(self, input_limit: int) -> int:
        """Bound of the accumulator, as a Python integer."""
        rows = np.abs(self.weight.astype(np.int64)).sum(axis=1).tolist()
        return max(row * input_limit + abs(b) for row, b in zip(rows, self.bias.tolist(), strict=True))


def evaluate_numpy(layers: list[IntegerLayer], values: Int64) -> Int64:
    """Of integers (rows, in), in int64."""
    for layer in layers:
        values = values @ layer.weight.astype(np.int64).T + layer.bias
        values = np.clip(values >> layer.shift, -layer.limit, layer.limit)
        if layer.leaky:
            values = np.where(values < 0, values >> LEAKY_SHIFT, values)
    return values


def evaluate_torch(layers: list[IntegerLayer], values: Tensor) -> Tensor:
    """The same of integers in float64."""
    for layer in layers:
        weight = torch.from_numpy(layer.weight.astype(np.float64))
        values = values @ weight.T + torch.from_numpy(layer.bias.astype(np.float64))
        values = torch.floor(values * 2.0**-layer.shift).clamp(-layer.limit, layer.limit)
        if layer.leaky:
            values = torch.where(values < 0, torch.floor(values * 2.0**-LEAKY_SHIFT), values)
    return values


def layers_of(arrays: dict[str, AnyArray], name: str) -> list[IntegerLayer]:
    """Of one network of a model file; empty where it is absent."""
    layers = []
    while f"{name}.{len(layers)}.weight" in arrays:
        prefix = f"{name}.{len(layers)}"
        shift, limit, leaky = arrays[f"{prefix}.scale"].tolist()
        layers.append(
            IntegerLayer(arrays[f"{prefix}.weight"], arrays[f"{prefix}.bias"], shift, limit, bool(leaky))
        )
    return layers


class IntegerNet(nn.Module):
    """Stands for a float network: values on the grid of its input to values on that of its output."""

    def __init__(self, layers: list[IntegerLayer], shape: Shape) -> None:
        super().__init__()
        self.integer_layers, self.shape = layers, shape

    def forward(self, values: Tensor) -> Tensor:
        integers = torch.round(values.double() * 2.0**self.shape.input_bits)
        return (evaluate_torch(self.integer_layers, integers) * 2.0**-self.shape.output_bits).float()


class _Frequencies(nn.Module):
    """Stands for the factorised model: bits by the tables of the file."""

    def __init__(self, frequencies: Int32) -> None:
        super().__init__()
        self.table = FREQUENCY_BITS - torch.log2(torch.from_numpy(frequencies.astype(np.float32)))

    def bits(self, values: Tensor) -> Tensor:
        inside = values.clamp(-HYPER_REACH, HYPER_REACH).long() + HYPER_REACH
        beyond = (values.abs() - HYPER_REACH + 1).clamp(min=0)
        # an escape and a code of about 2 log2 bits
        return self.table.T.gather(0, inside) + 2 * torch.log2(beyond + 1)


class IntegerModel(PaperModel):
    """An exported model in the place of a float one, for figures."""

    def __init__(self, arrays: dict[str, AnyArray]) -> None:
        super().__init__()
        found = {name: layers_of(arrays, name) for name in SHAPES}
        self.nets = nn.ModuleDict({n: IntegerNet(found[n], SHAPES[n]) for n in SHAPES if found[n]})
        if "hyper_frequencies" in arrays:
            self.factorised = _Frequencies(arrays["hyper_frequencies"])
        self.integer_grid = torch.from_numpy(arrays["grid"].astype(np.int64))
        self.eval()

    def interpolated(self, corners: tuple[Tensor, Tensor]) -> Tensor:
        rows, weights = corners
        levels = torch.arange(len(self.integer_grid))[None, :, None]
        corners_found = self.integer_grid[levels, rows]
        total = (weights[..., None] * corners_found).sum(dim=2)
        feature = total >> (GRID_BITS + FREQUENCY_BITS - INPUT_BITS)
        return (feature.reshape(len(rows), -1) * 2.0**-INPUT_BITS).float()
