"""What "quantised delta + zstd" codes: bins of a frame, and their differences from the previous frame.

Steps and grids are the codec's own (`plan_quantisation`), opacity is companded as in the codec. Rotations
are bins of three components (`smallest_three`), with ROTATION_STEP of the codec's stereographic step, which
gives about the codec's RMS angle. The ROTATION symbols (N, 4) are the component left out, then the bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import STEREO_FRACTION_BITS, Attribute
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.transform.rotation import ONE, round_divide
from evaluation.baselines import smallest_three

Planes = dict[Attribute, Int64]

#: quaternion component per stereographic unit
ROTATION_STEP = 1.5


def rotation_step(steps: dict[Attribute, int]) -> float:
    """Step of the quaternion components."""
    return ROTATION_STEP * steps[Attribute.ROTATION] / 2.0**STEREO_FRACTION_BITS


@dataclass(frozen=True)
class Coded:
    """A frame as both sides have it: symbols by attribute, and the rotations (N, 4) they stand for."""

    symbols: Planes
    quaternions: Float64

    @staticmethod
    def of(symbols: Planes, steps: dict[Attribute, int]) -> Coded:
        """The frame of `symbols`."""
        rotation = symbols[Attribute.ROTATION]
        quaternions = smallest_three.from_bins(rotation[:, 1:], rotation[:, 0], rotation_step(steps))
        return Coded(symbols, quaternions)

    def state(self, steps: dict[Attribute, int]) -> FrameState:
        """The integer state that the codec's own output process turns into floats."""
        planes = {a: Plane(v * steps[a]) for a, v in self.symbols.items() if a != Attribute.ROTATION}
        planes[Attribute.ROTATION] = Plane(np.rint(self.quaternions * ONE).astype(np.int64))
        return FrameState(planes)


def symbols_of(planes: Planes, steps: dict[Attribute, int], before: Coded | None) -> Planes:
    """Bins of state planes; `before` is the frame to be predicted from, in the same order."""
    quaternions = planes[Attribute.ROTATION] / ONE
    if before is None:
        left_out = smallest_three.largest(quaternions)
    else:
        left_out = smallest_three.kept(quaternions, before.symbols[Attribute.ROTATION][:, 0])
    three = smallest_three.to_bins(quaternions, left_out, rotation_step(steps))
    symbols = {a: round_divide(v, steps[a]) for a, v in planes.items() if a != Attribute.ROTATION}
    symbols[Attribute.ROTATION] = np.concatenate([left_out[:, None], three], axis=1)
    return symbols


def _predicted(attribute: Attribute, before: Coded, left_out: Int64, steps: dict[Attribute, int]) -> Int64:
    """What the previous frame says about the symbols of `attribute`."""
    if attribute != Attribute.ROTATION:
        return before.symbols[attribute]
    three = smallest_three.to_bins(before.quaternions, left_out, rotation_step(steps))
    return np.concatenate([before.symbols[attribute][:, :1], three], axis=1)


def differences(symbols: Planes, before: Coded, steps: dict[Attribute, int]) -> Planes:
    """Symbols minus what `before` predicts."""
    left_out = symbols[Attribute.ROTATION][:, 0]
    return {a: v - _predicted(a, before, left_out, steps) for a, v in symbols.items()}


def sums(residuals: Planes, before: Coded, steps: dict[Attribute, int]) -> Planes:
    """Inverse of `differences`."""
    rotation = Attribute.ROTATION
    left_out = residuals[rotation][:, 0] + before.symbols[rotation][:, 0]
    return {a: v + _predicted(a, before, left_out, steps) for a, v in residuals.items()}
