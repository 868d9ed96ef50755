"""Classes of the blocks of a P-frame: an encoder's choice that steers contexts alone (spec section 12.1)."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.codec.columns.magnitudes import row_sums
from dfcgs_codec.codec.motion.walk import FOLLOW, MIXED, STILL
from dfcgs_codec.codec.residual.classes import BLOCK_LOG2, DENSE, NUM_MAGNITUDES
from dfcgs_codec.transform.lod import ladder

#: with more significant Gaussians than this, all are coded, and their nearest neighbours help
_ALL_DENSE_SHARE = 0.85


def classify_blocks(symbols: Int64) -> tuple[Int64, Int64]:
    """Density and magnitude class of each block of `symbols` (N, C)."""
    starts = np.arange(0, len(symbols), 1 << BLOCK_LOG2)
    magnitude = row_sums(np.abs(symbols))
    significant = np.add.reduceat((magnitude > 0).astype(np.int64), starts)
    size = np.diff(np.append(starts, len(symbols)))
    density = np.where(significant * 4 < size, 1, 2)
    density = np.where(significant == size, DENSE, density)
    density[significant == 0] = 0
    if significant.sum() > _ALL_DENSE_SHARE * len(symbols):
        density[:] = DENSE
    total = np.add.reduceat(magnitude, starts) * 4
    mean = total // np.maximum(significant * symbols.shape[1], 1)
    return density, ladder(mean, NUM_MAGNITUDES)


def classify_modes(follows: Bool) -> Int64:
    """Mode (blocks,) of each block."""
    starts = np.arange(0, len(follows), 1 << BLOCK_LOG2)
    count = np.add.reduceat(follows.astype(np.int64), starts)
    size = np.diff(np.append(starts, len(follows)))
    return np.where(count == 0, STILL, np.where(count == size, FOLLOW, MIXED))
