"""Baseline "quantised delta + zstd": what one builds in an afternoon, built well.

Every attribute is on the codec's own grids and steps, Gaussians in the codec's Morton order. I-frames: bins,
or differences of bins along the order, whichever is smaller. P-frames: differences of bins from the previous
frame (the axes of rotations stay named as at the I-frame, signs continuous). Zigzag, byte planes, zstd
level 19, one frame of zstd per attribute. Sizes only: `delta_zstd_file` is the codec with files and decoder.

Rotations come in two forms. `quaternion`: the four components as bins, with the step that gives the
same largest error in degrees as the codec's. `turn`: the codec's own symbols (stereographic turn about
the Gaussian's axes, closed loop), which only leaves the entropy coder to compare.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import zstandard

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STEREO_FRACTION_BITS, Attribute
from dfcgs_codec.transform.rotation import ONE, round_divide
from evaluation.baselines.byte_planes import pack

Planes = dict[Attribute, Int64]

_LEVEL = 19
#: largest angle per step: 2 sqrt(3) radians stereographic, 2 radians per quaternion component
_QUATERNION_STEP = math.sqrt(3)


def compressed_size(values: Int64) -> int:
    """Bytes of integers (N, C) after byte planes and zstd; none at all where all are zero."""
    if not values.any():
        return 1
    return len(zstandard.ZstdCompressor(level=_LEVEL).compress(pack(values)))


def bins(planes: Planes, steps: dict[Attribute, int]) -> Planes:
    """State planes as bins; ROTATION as four quaternion components."""
    result = {}
    for attribute, values in planes.items():
        step = steps[attribute]
        if attribute == Attribute.ROTATION:
            real = _QUATERNION_STEP * step / 2.0**STEREO_FRACTION_BITS
            result[attribute] = np.rint(values / ONE / real).astype(np.int64)
        else:
            result[attribute] = round_divide(values, step)
    return result


@dataclass
class DeltaZstd:
    """Sizes of a sequence, frame by frame; planes come in the order of the GoF's I-frame."""

    steps: dict[Attribute, int]
    _before: Planes | None = None
    _quaternions: Int64 | None = None

    def intra(self, planes: Planes) -> dict[str, int]:
        """Bytes of an I-frame by attribute name."""
        current = bins(planes, self.steps)
        self._before, self._quaternions = current, planes[Attribute.ROTATION]
        sizes = {}
        for attribute, values in current.items():
            along = np.diff(values, axis=0, prepend=np.zeros((1, values.shape[1]), np.int64))
            sizes[attribute.name] = min(compressed_size(values), compressed_size(along))
        return sizes

    def inter(self, planes: Planes, turns: Int64 | None) -> dict[str, int]:
        """Bytes of a P-frame by attribute name; TURN is the other form of ROTATION."""
        assert self._before is not None
        flipped = (planes[Attribute.ROTATION] * self._quaternions).sum(axis=1) < 0
        rotations = np.where(flipped[:, None], -planes[Attribute.ROTATION], planes[Attribute.ROTATION])
        self._quaternions = rotations
        current = bins(planes | {Attribute.ROTATION: rotations}, self.steps)
        sizes = {a.name: compressed_size(v - self._before[a]) for a, v in current.items()}
        sizes["TURN"] = 1 if turns is None else compressed_size(turns)
        self._before = current
        return sizes
