"""Where a scene is and how large, so that one model fits all (spec annex B.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64

#: normalised positions have this many fraction bits
NORMAL_BITS = 15
#: and lie within +- this many units
NORMAL_LIMIT = 4
#: hundredths of the Gaussians, by rank along an axis, that say how far the scene reaches
_LOW_RANK, _HIGH_RANK = 5, 95


def shifted(values: Int64, bits: int) -> Int64:
    """`values` * 2**bits, rounded down."""
    return values << bits if bits >= 0 else values >> min(-bits, 63)


@dataclass(frozen=True)
class Normalisation:
    """The middle of a scene, `center` (3,) int64; it reaches 2**`exponent` grid units from there."""

    center: Int64
    exponent: int

    @staticmethod
    def of(positions: Int64) -> Normalisation:
        """Of `positions` (N, 3): medians, and where all but a twentieth of them end, rounded up."""
        count, center, extent = len(positions), [], 1
        low, high = count * _LOW_RANK // 100, count * _HIGH_RANK // 100
        for axis in range(3):
            ranked = np.sort(positions[:, axis])
            middle = int(ranked[count >> 1])
            center.append(middle)
            extent = max(extent, int(ranked[high]) - middle, middle - int(ranked[low]))
        return Normalisation(np.array(center, np.int64), (extent - 1).bit_length())

    def of_positions(self, positions: Int64) -> Int64:
        """Normalised `positions` (N, 3), 15 fraction bits, clipped to +-4."""
        limit = NORMAL_LIMIT << NORMAL_BITS
        normal: Int64 = np.clip(shifted(positions - self.center, NORMAL_BITS - self.exponent), -limit, limit)
        return normal
