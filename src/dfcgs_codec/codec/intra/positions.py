"""Positions of an I-frame, coarse to fine along the Morton order (spec section 11.1).

A cell that holds n Gaussians is halved again and again, one axis at a time; coded is how many fall in
the lower half. A cell with one Gaussian stops: its remaining bits are raw. Coincident Gaussians stay
together to the end, so 200 k of them cost a few bytes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.bitstream.frame_headers import SortGrid
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.entropy.coder import split_model
from dfcgs_codec.entropy.symbols import (
    Groups,
    code_bits,
    code_escapes,
    code_residuals,
    code_with_models,
)
from dfcgs_codec.entropy.tables import MAX_SPLIT_COUNT, NUM_SCALES, Shape
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.morton import morton_cells, morton_keys

#: cells of 2, of 3 and 4, of 5 to 32 Gaussians have a bias each
_BIAS_CLASS_STARTS = (2, 3, 5)
#: scale index of a Gaussian table for cells of 2**b..2**(b+1) Gaussians: sigma = a quarter of them
_LARGE_CELL_SCALE = 17


@dataclass(frozen=True)
class _Cells:
    """Cells of one depth that hold two Gaussians or more: first Gaussian, number, key so far."""

    first: Int64
    count: Int64
    key: Int64


def _code_small(coder: SymbolCoder, lower: Int64 | None, counts: Int64) -> Int64:
    classes = np.searchsorted(_BIAS_CLASS_STARTS, counts, side="right") - 1
    biases = [0] * len(_BIAS_CLASS_STARTS)
    for index in np.unique(classes).tolist():
        rows = classes == index

        def evidence(rows: Bool = rows) -> tuple[Int64, Int64]:
            assert lower is not None
            return counts[rows], lower[rows]

        biases[index] = coder.split_bias(evidence)
    flat = split_model(0, 2)
    models = [flat] * (MAX_SPLIT_COUNT + 1)
    for count in np.unique(counts).tolist():
        index = int(np.searchsorted(_BIAS_CLASS_STARTS, count, side="right")) - 1
        models[count] = split_model(biases[index], count)
    return code_with_models(coder, lower, Groups(counts, len(models)), models)


def _code_large(coder: SymbolCoder, lower: Int64 | None, counts: Int64) -> Int64:
    size_class = np.frexp(counts.astype(np.float64))[1]
    tables = Shape.GAUSSIAN * NUM_SCALES + np.clip(
        6 * np.arange(26, dtype=np.int64) - 6 + _LARGE_CELL_SCALE, 0, NUM_SCALES - 1
    )
    half = counts >> 1
    given = None if lower is None else lower - half
    return code_residuals(coder, given, size_class.astype(np.uint8), tables) + half


def _split(coder: SymbolCoder, cells: _Cells, lower: Int64 | None) -> Int64:
    small = cells.count <= MAX_SPLIT_COUNT
    result = np.empty(len(cells.count), np.int64)
    for rows, code in ((small, _code_small), (~small, _code_large)):
        if rows.any():
            result[rows] = code(coder, None if lower is None else lower[rows], cells.count[rows])
    if (result < 0).any() or (result > cells.count).any():
        raise CorruptBitstream("a cell's halves do not add up")
    return result


def _halves(cells: _Cells, lower: Int64) -> _Cells:
    """Both halves of every cell, empty ones left out, in Morton order."""
    first = np.stack([cells.first, cells.first + lower], 1).ravel()
    count = np.stack([lower, cells.count - lower], 1).ravel()
    key = np.stack([cells.key << 1, cells.key << 1 | 1], 1).ravel()
    kept = count > 0
    return _Cells(first[kept], count[kept], key[kept])


def _code_keys(coder: SymbolCoder, keys: Int64 | None, key_bits: int, count: int) -> Int64:
    """Sorted Morton keys (N,) of `key_bits` bits."""
    result = np.zeros(count, np.int64)
    remaining = np.zeros(count, np.int64)
    zero = np.zeros(1, np.int64)
    cells = _Cells(zero, np.array([count], np.int64), zero)
    for depth in range(key_bits, -1, -1):
        single = cells.count == 1
        result[cells.first[single]] = cells.key[single] << depth
        remaining[cells.first[single]] = depth
        cells = _Cells(cells.first[~single], cells.count[~single], cells.key[~single])
        if depth == 0 or not len(cells.count):
            break
        lower = None
        if keys is not None:
            upper_start = (cells.key << 1 | 1) << (depth - 1)
            lower = np.minimum(np.searchsorted(keys, upper_start) - cells.first, cells.count)
        cells = _halves(cells, _split(coder, cells, lower))
    for first, number, key in zip(cells.first, cells.count, cells.key, strict=True):
        result[first : first + number] = key
    for depth in np.unique(remaining).tolist():
        rows = np.flatnonzero(remaining == depth)
        low = None if keys is None else keys[rows] & ((1 << depth) - 1)
        result[rows] |= code_bits(coder, low, depth, len(rows))
    return result


def code_positions(coder: SymbolCoder, indices: Int64 | None, grid: SortGrid, count: int) -> Int64:
    """Position indices (N, 3) int64 in canonical order, in units of the position step."""
    top = (1 << grid.bits) - 1
    origin = np.array(grid.origin, np.int64)
    keys = wide = None
    if indices is not None:
        wide = (indices >> grid.shift) - origin
        keys = morton_keys(np.clip(wide, 0, top))
    keys = _code_keys(coder, keys, 3 * grid.bits, count)
    cells = morton_cells(keys)
    if grid.has_excess:
        for axis in range(3):
            _code_excess(coder, None if wide is None else wide[:, axis], cells[:, axis], top)
    low = None if indices is None else (indices & ((1 << grid.shift) - 1)).ravel()
    bits = code_bits(coder, low, grid.shift, 3 * count).reshape(count, 3)
    return ((cells + origin) << grid.shift) | bits


def _code_excess(coder: SymbolCoder, wide: Int64 | None, cells: Int64, top: int) -> None:
    """Move the cells at either end of an axis out to where they really are."""
    low = np.flatnonzero(cells == 0)
    high = np.flatnonzero(cells == top)
    below = None if wide is None else -np.minimum(wide[low], 0)
    cells[low] -= code_escapes(coder, below, len(low))
    above = None if wide is None else np.maximum(wide[high], top) - top
    cells[high] += code_escapes(coder, above, len(high))
