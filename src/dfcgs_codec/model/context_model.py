"""The frozen prior of profile `main` (spec section 17): decoded context to the table of a symbol.

Small networks turn what both sides know of a Gaussian or a control point into a class, about the logarithm of
how large its symbol will be; tables frozen with the networks say how symbols of a class are distributed. All
in integers that float32 holds exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dfcgs_codec.array_types import Float32, Int64, Integers, UInt8
from dfcgs_codec.entropy.coder import Model, RangeCoder, categorical
from dfcgs_codec.entropy.symbols import EXPLICIT_REACH, Groups, code_residuals, code_with_models
from dfcgs_codec.entropy.tables import FREQUENCY_BITS, NUM_SCALES, NUM_SHAPES
from dfcgs_codec.model.layers import LayerError
from dfcgs_codec.model.weights_file import Arrays, digest_of

#: inputs of the networks are 0 to this
INPUT_LIMIT = 255
#: activations but the last are 0 to this
ACTIVATION_LIMIT = 1023
#: classes of symbols; below the latter the kind of a symbol and the fraction of its prediction count, too
NUM_CLASSES = 40
NUM_LOW_CLASSES = 18
#: free; must not be all zero: three columns or more left, two, the last one
NUM_KINDS = 4
#: fraction of the prediction: none, about a quarter, about a half
NUM_FRACTIONS = 3
NUM_CELLS = NUM_KINDS * NUM_FRACTIONS * NUM_LOW_CLASSES + NUM_CLASSES - NUM_LOW_CLASSES
#: significance of a Gaussian
NUM_FLAG_CLASSES = 32
#: widths of the networks' inputs: common to all symbols of a Gaussian or control point, and others
NUM_COMMON_INPUTS, NUM_FLAG_INPUTS, NUM_COLUMN_INPUTS = 20, 2, 10
NUM_CONTROL_COMMON, NUM_CONTROL_INPUTS = 4, 10
NUM_DENSITY_CLASSES = 4
#: columns of a control point's symbols; neighbours' mean, residuals of earlier columns, symbol before, habit
CONTROL_WEIGHTS = (6, 8)
#: arrays of a file besides its networks and their models
_TABLES = (
    "columns.tables",
    "columns.frequencies",
    "control.tables",
    "control.frequencies",
    "magnitudes.tables",
    "control.weights",
)
#: sums below this are exact in float32
_EXACT = 1 << 24
_MAX_SHIFT = 23
#: rows at a time, so that activations stay in the cache
_ROWS = 8192


def cells_of(classes: Int64, kinds: Int64, fractions: Int64) -> Int64:
    """Table of each symbol from its class, its kind and the fraction of its prediction, all (rows,)."""
    low = (kinds * NUM_FRACTIONS + fractions) * NUM_LOW_CLASSES + classes
    high = NUM_KINDS * NUM_FRACTIONS * NUM_LOW_CLASSES - NUM_LOW_CLASSES + classes
    return np.where(classes < NUM_LOW_CLASSES, low, high)


@dataclass(frozen=True)
class NarrowLayer:
    """y = clip((W x + b) >> shift, 0, limit); `weight` (out, in), `bias` (out,) are integers in float32."""

    weight: Float32
    bias: Float32
    shift: int
    limit: int

    @staticmethod
    def of(arrays: Arrays, prefix: str, input_limit: int) -> NarrowLayer:
        """From `prefix`.weight int16, .bias int32, .scale int64 (shift, limit); LayerError if not exact."""
        try:
            weight, bias, scale = (arrays[f"{prefix}.{part}"] for part in ("weight", "bias", "scale"))
        except KeyError as error:
            raise LayerError(f"{prefix} lacks an array") from error
        fits = weight.ndim == 2 and bias.shape == weight.shape[:1] and scale.shape == (2,)
        kinds = (weight.dtype.str[1:], bias.dtype.str[1:], scale.dtype.str[1:])
        if not fits or kinds != ("i2", "i4", "i8"):
            raise LayerError(f"the arrays of {prefix} do not fit each other")
        shift, limit = scale.tolist()
        if not (0 <= shift <= _MAX_SHIFT and 0 < limit <= ACTIVATION_LIMIT):
            raise LayerError(f"{prefix}: shift {shift} or limit {limit} is out of range")
        wide = np.abs(weight.astype(np.int64)).sum(axis=1) * input_limit + np.abs(bias.astype(np.int64))
        if wide.max() >= _EXACT:
            raise LayerError(f"{prefix}: a sum of {wide.max()} is possible, 2**24 is the limit")
        return NarrowLayer(weight.astype(np.float32), bias.astype(np.float32), shift, limit)

    def activate(self, sums: Float32) -> Float32:
        """Of sums (rows, out), changed in place."""
        sums *= np.float32(2.0**-self.shift)
        np.floor(sums, out=sums)
        np.clip(sums, 0, self.limit, out=sums)
        return sums

    def __call__(self, inputs: Float32) -> Float32:
        """Outputs (rows, out) of `inputs` (rows, in)."""
        sums = inputs @ self.weight.T
        sums += self.bias
        return self.activate(sums)


@dataclass(frozen=True)
class ClassNetwork:
    """Layers that end in one value, a class. The first columns of the input are `num_common`.

    What they add to the first layer is found once for all symbols of a Gaussian.
    """

    layers: tuple[NarrowLayer, ...]
    num_common: int

    @staticmethod
    def of(arrays: Arrays, name: str, widths: tuple[int, int], num_classes: int) -> ClassNetwork:
        """The network `name` with `widths` inputs, common ones and others; LayerError for anything else."""
        layers: list[NarrowLayer] = []
        limit, width = INPUT_LIMIT, sum(widths)
        while f"{name}.{len(layers)}.weight" in arrays:
            layer = NarrowLayer.of(arrays, f"{name}.{len(layers)}", limit)
            if layer.weight.shape[1] != width:
                raise LayerError(f"{name} takes {layer.weight.shape[1]} values and is given {width}")
            layers.append(layer)
            limit, width = layer.limit, layer.weight.shape[0]
        if not layers or width != 1 or limit != num_classes - 1:
            raise LayerError(f"{name} does not end in one of {num_classes} classes")
        return ClassNetwork(tuple(layers), widths[0])

    def prepare(self, common: UInt8) -> Float32:
        """The part of the first sums (rows, hidden) that `common` inputs (rows, num_common) make."""
        first = self.layers[0]
        sums: Float32 = common.astype(np.float32) @ first.weight[:, : self.num_common].T + first.bias
        return sums

    def classes(self, prepared: Float32, others: UInt8) -> Int64:
        """Classes (rows,) from what `prepare` gave and the `others` (rows, inputs - num_common)."""
        result = np.empty(len(others), np.int64)
        first = self.layers[0]
        weight = first.weight[:, self.num_common :].T
        for start in range(0, len(others), _ROWS):
            part = slice(start, start + _ROWS)
            sums = others[part].astype(np.float32) @ weight
            sums += prepared[part]
            values = first.activate(sums)
            for layer in self.layers[1:]:
                values = layer(values)
            result[part] = values[:, 0]
        return result


class Part(Protocol):
    """What codes one sort of symbols; training puts one in its place that looks on."""

    def prepare(self, common: UInt8) -> Float32:
        """See ClassNetwork.prepare."""

    def code(
        self,
        coder: RangeCoder,
        values: Int64 | None,
        inputs: tuple[Float32, UInt8],
        cells: tuple[Int64, Int64],
    ) -> Int64:
        """Integers (rows,) by `inputs`, what `prepare` gave and the others; `cells` are kind and fraction."""


@dataclass(frozen=True)
class SymbolPart:
    """A network and tables by cell: `tables` (NUM_CELLS,) as `code_residuals` takes them, and `models`."""

    network: ClassNetwork
    tables: Int64
    models: list[Model]

    @staticmethod
    def of(arrays: Arrays, name: str, widths: tuple[int, int]) -> SymbolPart:
        """The part `name` of a file."""
        network = ClassNetwork.of(arrays, name, widths, NUM_CLASSES)
        tables, models = arrays[f"{name}.tables"].astype(np.int64), arrays[f"{name}.frequencies"]
        fits = tables.shape == (NUM_CELLS,) and models.ndim == 2 and models.shape[1] == 2 * EXPLICIT_REACH + 1
        if not fits or tables.min() < -len(models) or tables.max() >= NUM_SHAPES * NUM_SCALES:
            raise LayerError(f"the tables of {name} do not fit each other")
        return SymbolPart(network, tables, [_model(row) for row in models])

    def prepare(self, common: UInt8) -> Float32:
        """See Part."""
        return self.network.prepare(common)

    def code(
        self,
        coder: RangeCoder,
        values: Int64 | None,
        inputs: tuple[Float32, UInt8],
        cells: tuple[Int64, Int64],
    ) -> Int64:
        """See Part."""
        found = cells_of(self.network.classes(*inputs), *cells).astype(np.uint8)
        return code_residuals(coder, values, found, self.tables, self.models)


class Flags(Protocol):
    """What codes flags."""

    def prepare(self, common: UInt8) -> Float32:
        """See ClassNetwork.prepare."""

    def code(self, coder: RangeCoder, values: Int64 | None, inputs: tuple[Float32, UInt8]) -> Int64:
        """Flags (rows,) by `inputs`, what `prepare` gave and the others."""


@dataclass(frozen=True)
class FlagPart:
    """A network and the models of a flag, one for each class."""

    network: ClassNetwork
    models: list[Model]

    @staticmethod
    def of(arrays: Arrays, name: str, widths: tuple[int, int]) -> FlagPart:
        """The part `name` of a file."""
        network = ClassNetwork.of(arrays, name, widths, NUM_FLAG_CLASSES)
        return FlagPart(network, _models(arrays, f"{name}.frequencies", (NUM_FLAG_CLASSES, 2)))

    def prepare(self, common: UInt8) -> Float32:
        """See Part."""
        return self.network.prepare(common)

    def code(self, coder: RangeCoder, values: Int64 | None, inputs: tuple[Float32, UInt8]) -> Int64:
        """See Flags."""
        groups = Groups(self.network.classes(*inputs), NUM_FLAG_CLASSES)
        return code_with_models(coder, values, groups, self.models)


def _model(frequencies: Integers) -> Model:
    wide = frequencies.astype(np.int64)
    if wide.min() < 1 or wide.sum() != 1 << FREQUENCY_BITS:
        raise LayerError("frequencies are not positive or do not sum to 2**24")
    return categorical(wide)


def _models(arrays: Arrays, name: str, shape: tuple[int, int]) -> list[Model]:
    if name not in arrays or arrays[name].shape != shape:
        raise LayerError(f"{name} is not of shape {shape}")
    return [_model(row) for row in arrays[name]]


@dataclass(frozen=True)
class ContextModel:
    """The frozen prior: its id, its digest (32 bytes), and what codes each sort of symbols.

    `densities` by class of the block before and beside; `magnitudes` (8,): tables by density and history;
    `control_weights` (6, 8): by column of a control point's symbols, Q8, those of the neighbours' mean, of
    earlier columns' residuals, of the symbol before and of habits.
    """

    model_id: str
    digest: bytes
    flags: Flags
    columns: Part
    control: Part
    densities: list[Model]
    magnitudes: Int64
    control_weights: Int64

    @staticmethod
    def of_arrays(model_id: str, arrays: Arrays) -> ContextModel:
        """From the arrays of a file; LayerError where they make no model."""
        missing = [name for name in _TABLES if name not in arrays]
        if missing:
            raise LayerError(f"{', '.join(missing)} are missing")
        magnitudes, weights = arrays["magnitudes.tables"], arrays["control.weights"]
        if magnitudes.shape != (2 * NUM_DENSITY_CLASSES,) or weights.shape != CONTROL_WEIGHTS:
            raise LayerError("magnitudes.tables or control.weights are not of the shape they should be")
        if magnitudes.min() < 0 or magnitudes.max() >= NUM_SHAPES * NUM_SCALES or abs(weights).max() > 4096:
            raise LayerError("magnitudes.tables or control.weights are out of range")
        return ContextModel(
            model_id,
            digest_of(arrays),
            FlagPart.of(arrays, "flags", (NUM_COMMON_INPUTS, NUM_FLAG_INPUTS)),
            SymbolPart.of(arrays, "columns", (NUM_COMMON_INPUTS, NUM_COLUMN_INPUTS)),
            SymbolPart.of(arrays, "control", (NUM_CONTROL_COMMON, NUM_CONTROL_INPUTS)),
            _models(arrays, "densities.frequencies", (NUM_DENSITY_CLASSES**2, NUM_DENSITY_CLASSES)),
            magnitudes.astype(np.int64),
            weights.astype(np.int64),
        )
