"""Which splats each tile draws, near to far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dfcgs_codec.array_types import Int32, Int64
from lab.render.constants import TILE
from lab.render.kernel import kernel
from lab.render.projection import Splats


class TileLists(NamedTuple):
    """The splats of tile t are `splats[starts[t]:starts[t + 1]]`, near to far; tiles in row order."""

    columns: int
    starts: Int64
    splats: Int32


def depth_order(splats: Splats) -> Int64:
    """Indices of the drawn splats, near to far, equal depths in the order of the cloud."""
    drawn = np.flatnonzero(splats.tiles).astype(np.uint64)
    # depths are positive, so their bits sort as they do; the index below makes every key unique,
    # which lets numpy's fast unstable sort serve for a stable one
    keys = splats.depths[drawn].view(np.uint32).astype(np.uint64) << np.uint64(32) | drawn
    keys.sort()
    return (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)


def bin_splats(splats: Splats, width: int, height: int) -> TileLists:
    """The tile lists of an image of width x height pixels."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    order = depth_order(splats)
    starts = np.zeros(columns * rows + 1, np.int64)
    _count(order, splats.rects, columns, starts)
    np.cumsum(starts, out=starts)
    members = np.empty(starts[-1], np.int32)
    _fill(order, splats.rects, columns, starts[:-1].copy(), members)
    return TileLists(columns, starts, members)


@kernel
def _count(order, rects, columns, starts):
    for n in order:
        for row in range(rects[n, 2] // TILE, (rects[n, 3] - 1) // TILE + 1):
            for column in range(rects[n, 0] // TILE, (rects[n, 1] - 1) // TILE + 1):
                starts[row * columns + column + 1] += 1


@kernel
def _fill(order, rects, columns, free, members):
    for n in order:
        for row in range(rects[n, 2] // TILE, (rects[n, 3] - 1) // TILE + 1):
            for column in range(rects[n, 0] // TILE, (rects[n, 1] - 1) // TILE + 1):
                tile = row * columns + column
                members[free[tile]] = n
                free[tile] += 1
