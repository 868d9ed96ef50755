"""Attributes of Gaussians as grey images for a video encoder.

A column (N,) becomes a map: Gaussians in Morton order fill blocks of 64 x 64 pixels along a Z-curve, so
that neighbours in space are mostly neighbours in the image; pixels left over are the median. The C maps of an
attribute are tiles of one image.

Pixels have BITS bits. Levels beyond them are folded: the low part runs up and down (a triangle wave), so that
it has no jumps and a lossy pixel is off by no more than its own error; the high part counts the folds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64, UInt16

BITS = 12
_FOLD = 1 << BITS
#: the largest block of HEVC
_SIDE = 64


def _curve() -> Int64:
    """Row and column (4096, 2) of the pixels of a block along the Z-curve."""
    index = np.arange(_SIDE * _SIDE)
    place = np.zeros((len(index), 2), np.int64)
    for bit in range(6):
        place[:, 1] |= (index >> (2 * bit) & 1) << bit
        place[:, 0] |= (index >> (2 * bit + 1) & 1) << bit
    return place


@dataclass(frozen=True)
class Layout:
    """Where the values of N Gaussians and C columns are in an image."""

    num_gaussians: int
    columns: int

    @property
    def _blocks(self) -> tuple[int, int]:
        """Block rows and columns of a map."""
        count = -(-self.num_gaussians // _SIDE**2)
        wide = math.isqrt(count - 1) + 1
        return -(-count // wide), wide

    @property
    def _tiles(self) -> tuple[int, int]:
        """Rows and columns of maps in the image."""
        wide = math.isqrt(self.columns - 1) + 1
        return -(-self.columns // wide), wide

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the image in pixels."""
        (block_rows, block_columns), (tile_rows, tile_columns) = self._blocks, self._tiles
        return _SIDE * block_rows * tile_rows, _SIDE * block_columns * tile_columns

    def pixels(self) -> tuple[Int64, Int64]:
        """Row and column, each (N, C), of every value."""
        (block_rows, block_columns), (_, tile_columns) = self._blocks, self._tiles
        index, curve = np.arange(self.num_gaussians), _curve()
        block, inside = index // _SIDE**2, curve[index % _SIDE**2]
        row = _SIDE * (block // block_columns) + inside[:, 0]
        column = _SIDE * (block % block_columns) + inside[:, 1]
        tile = np.arange(self.columns)
        down, right = (
            _SIDE * block_rows * (tile // tile_columns),
            _SIDE * block_columns * (tile % tile_columns),
        )
        return row[:, None] + down, column[:, None] + right

    def image(self, values: Int64) -> UInt16:
        """Image of `values` (N, C); pixels that hold none are the median."""
        result = np.full(self.shape, -1, np.int64)
        result[self.pixels()] = values
        result[result < 0] = int(np.median(values))
        return result.astype(np.uint16)

    def values(self, image: UInt16) -> Int64:
        """Inverse of `image`."""
        return image[self.pixels()].astype(np.int64)


def fold(levels: Int64) -> tuple[Int64, Int64]:
    """Low parts, 0 .. 2**BITS - 1, and high parts of levels >= 0."""
    high, low = levels >> BITS, levels & (_FOLD - 1)
    return np.where(high & 1, _FOLD - 1 - low, low), high


def unfold(low: Int64, high: Int64) -> Int64:
    """Inverse of `fold`."""
    return (high << BITS) + np.where(high & 1, _FOLD - 1 - low, low)
