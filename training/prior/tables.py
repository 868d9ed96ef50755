"""The tables of the prior: how the symbols of each cell are distributed in the recordings."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.encoder.columns.side_information import table_costs
from dfcgs_codec.entropy.coder import scale_model
from dfcgs_codec.entropy.symbols import EXPLICIT_REACH
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, frequencies_from_weights, split_scale
from dfcgs_codec.model.context_model import (
    NUM_CELLS,
    NUM_CLASSES,
    NUM_DENSITY_CLASSES,
    NUM_FLAG_CLASSES,
    NUM_FRACTIONS,
    NUM_KINDS,
    NUM_LOW_CLASSES,
    cells_of,
)
from training.prior.nets import CLASSES_PER_LOGIT, CLASSES_PER_OCTAVE, EVEN_CLASS, UNIT_CLASS

#: symbols that the fitted curve counts as, where a cell has few
_PRIOR_SYMBOLS = 64.0
#: a table of its own must save this share of the bits
_WORTH = 0.002
_FEWEST = 1000


def scale_of_class(index: int) -> int:
    """Table of the Laplace distribution of a class's mean magnitude."""
    sigma_log2 = (index - UNIT_CLASS) / CLASSES_PER_OCTAVE + 0.5
    return int(np.clip(round(26 + 6 * sigma_log2), 0, NUM_SCALES - 1))


def _class_of_cells() -> Int64:
    """Class of each cell."""
    grid = np.meshgrid(range(NUM_KINDS), range(NUM_FRACTIONS), range(NUM_CLASSES), indexing="ij")
    kinds, fractions, classes = (part.ravel() for part in grid)
    found = np.zeros(NUM_CELLS, np.int64)
    found[cells_of(classes, kinds, fractions)] = classes
    return found


def _spread(table: int) -> Float64:
    """Probabilities of the symbols -15..15 (the ends: all beyond) by a scale table."""
    shape, scale = divmod(table, NUM_SCALES)
    base, low_bits = split_scale(scale)
    assert low_bits == 0
    known = scale_model(Shape(shape), base).frequencies.astype(np.float64)
    reach = len(known) // 2
    found = np.zeros(2 * EXPLICIT_REACH + 1)
    places = np.clip(np.arange(-reach, reach + 1), -EXPLICIT_REACH, EXPLICIT_REACH) + EXPLICIT_REACH
    np.add.at(found, places, known)
    return found / known.sum()


def symbol_tables(classes: Int64, cells: Int64, values: Int64) -> tuple[Int64, Int64]:
    """`tables` (NUM_CELLS,) and `frequencies` (tables, 31) for symbols (rows,) of these classes and cells."""
    kinds, fractions = cells[:, 0].astype(np.int64), cells[:, 1].astype(np.int64)
    place = cells_of(classes, kinds, fractions)
    costs = table_costs(values, place.astype(np.uint8), NUM_CELLS).reshape(NUM_CELLS, -1)
    class_of = _class_of_cells()
    order = np.argsort(place, kind="stable")
    bounds = np.searchsorted(place[order], np.arange(NUM_CELLS + 1))
    tables, rows = np.zeros(NUM_CELLS, np.int64), []
    for cell in range(NUM_CELLS):
        index = int(class_of[cell])
        found = values[order[bounds[cell] : bounds[cell + 1]]]
        expected = Shape.LAPLACE * NUM_SCALES + scale_of_class(index)
        tables[cell] = expected
        if len(found) >= _FEWEST // 10:
            tables[cell] = int(costs[cell].argmin())
        own = _own_table(found, int(tables[cell]), float(costs[cell].min()) if len(found) else 0.0)
        if index < NUM_LOW_CLASSES and own is not None:
            rows.append(own)
            tables[cell] = -len(rows)
    frequencies = np.array(rows, np.int64).reshape(-1, 2 * EXPLICIT_REACH + 1)
    return tables, frequencies


def for_all_kinds(tables: Int64) -> Int64:
    """The tables of kind and fraction 0 for all kinds and fractions."""
    cells = cells_of(_class_of_cells(), np.zeros(NUM_CELLS, np.int64), np.zeros(NUM_CELLS, np.int64))
    return tables[cells]


def _own_table(values: Int64, table: int, cost: float) -> Int64 | None:
    """Frequencies of a cell, if they are worth it."""
    if len(values) < _FEWEST or split_scale(table % NUM_SCALES)[1]:
        return None
    clipped = np.clip(values, -EXPLICIT_REACH, EXPLICIT_REACH) + EXPLICIT_REACH
    counts = np.bincount(clipped, minlength=2 * EXPLICIT_REACH + 1) + _PRIOR_SYMBOLS * _spread(table)
    frequencies = frequencies_from_weights(np.rint(counts * (1 << 10)).astype(np.int64))
    bits = 24 - np.log2(frequencies)
    far = np.abs(values[np.abs(values) >= EXPLICIT_REACH]) - EXPLICIT_REACH
    own = bits[clipped].sum() + (5 + np.floor(np.log2(far + 1))).sum()
    return frequencies if own < (1 - _WORTH) * cost else None


def flag_frequencies(classes: Int64, values: Int64) -> Int64:
    """Frequencies (classes, 2) of flags."""
    share = 1 / (1 + np.exp(-(np.arange(NUM_FLAG_CLASSES) - EVEN_CLASS) / CLASSES_PER_LOGIT))
    ones = np.bincount(classes, weights=values, minlength=NUM_FLAG_CLASSES) + _PRIOR_SYMBOLS * share
    both = np.bincount(classes, minlength=NUM_FLAG_CLASSES) + _PRIOR_SYMBOLS
    weights = np.stack([both - ones, ones], axis=1)
    weights *= (1 << 24) / weights.sum(axis=1, keepdims=True)
    return np.array([frequencies_from_weights(np.rint(row).astype(np.int64)) for row in weights])


def density_frequencies(contexts: Int64, values: Int64) -> Int64:
    """Frequencies (16, 4) of density classes."""
    size = NUM_DENSITY_CLASSES
    counts = np.bincount(contexts * size + values, minlength=size**3).reshape(-1, size) * 16 + 8
    return np.array([frequencies_from_weights(row) for row in counts])


def magnitude_tables(contexts: Int64, values: Int64) -> Int64:
    """Tables (8,) of magnitude classes."""
    costs = table_costs(values, contexts.astype(np.uint8), 2 * NUM_DENSITY_CLASSES)
    found = costs.reshape(2 * NUM_DENSITY_CLASSES, -1).argmin(axis=1)
    used = np.bincount(contexts, minlength=2 * NUM_DENSITY_CLASSES) > 0
    return np.where(used, found, Shape.LAPLACE * NUM_SCALES + 26)
