"""Tracked sequences as trackers really give them: same N and order, no attribute quite at rest.

Statistics hold from one frame to the next; lengths are shares of the scene's size in its first frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import rotations
from lab.scenes.fields import field_for, scene_size

#: keep the random numbers apart from those of other stages with the same seed
NOISY_STREAM, DRIFT_STREAM = 11, 12


@dataclass(frozen=True)
class NoisyStatistics:
    """3DGStream (evidence.md, section 2), and assumptions where no source states a figure."""

    same_positions: float = 0.35
    same_scales: float = 0.98
    same_opacities: float = 0.96
    #: median jitter of the others, share of the scene's size
    jitter: float = 6.6e-4
    #: median turn of all, radians
    turn: float = 0.017
    #: assumed: standard deviation of a changed log-scale or logit-opacity
    scale_change: float = 0.02
    opacity_change: float = 0.1
    #: assumed: spread of the logarithm of a jitter's length, for a few Gaussians jump much farther than most
    tail: float = 0.5
    #: assumed: share of a jitter that neighbours have in common, for a tracker's field is smooth, not white
    common: float = 0.5
    #: assumed: share of the accumulated jitter that a frame takes back, so that Gaussians do not wander off
    pull: float = 0.05


@dataclass(frozen=True)
class DriftAmplitudes:
    """How far each attribute drifts (standard deviation) where the magnitude over space is 1."""

    position: float = 2e-3  # share of the scene's size
    rotation: float = 0.03  # radians
    scale: float = 0.03  # log-scale
    opacity: float = 0.1  # logit
    sh_dc: float = 0.03
    sh_rest: float = 0.01
    #: white noise of each frame relative to the drift
    noise: float = 0.05
    #: spread of the logarithm of the magnitude over space
    spread: float = 1.0
    wavelength: float = 0.5  # share of the scene's size
    period: float = 90.0  # frames


class _NoisyTracker:
    """The jitter that a tracker has accumulated for each of N Gaussians."""

    def __init__(self, first: GaussianCloud, rng: np.random.Generator, statistics: NoisyStatistics) -> None:
        n = first.num_gaussians
        self.statistics, self.rng = statistics, rng
        self.rest, self.size = first.positions, scene_size(first.positions)
        self.offset, self.turn = np.zeros((n, 3)), np.zeros((n, 3))
        self.scale, self.opacity = np.zeros((n, 3), np.float32), np.zeros(n, np.float32)
        self.common = field_for(first, rng, 6, wavelength=0.1, period=3.0)
        self.calm = field_for(first, rng, 1, wavelength=0.3, period=60.0)

    def advance(self, index: int, moved: Float64) -> None:
        """One frame on; `moved` (N,) is how far the clean sequence moved."""
        s = self.statistics
        common = self.common(self.rest, index)
        steps = self._steps(common[:, :3], s.jitter * self.size) - s.pull * self.offset
        steps[self._still(moved, index)] = 0.0
        self.offset += steps
        self.turn += self._steps(common[:, 3:], s.turn) - s.pull * self.turn
        _change_some(self.scale, s.same_scales, s.scale_change, self.rng)
        _change_some(self.opacity, s.same_opacities, s.opacity_change, self.rng)

    def observe(self, frame: GaussianCloud) -> GaussianCloud:
        """The clean frame as tracked."""
        turned = rotations.multiply(rotations.from_vectors(self.turn), frame.rotations)
        return replace(
            frame,
            positions=(frame.positions + self.offset).astype(np.float32),
            rotations=turned.astype(np.float32),
            scales=frame.scales + self.scale,
            opacities=frame.opacities + self.opacity,
        )

    def _steps(self, common: Float64, median: float) -> Float64:
        """(N, 3) vectors of that median length, whose directions neighbours partly share."""
        s = self.statistics
        own = self.rng.standard_normal(common.shape)
        mixed = np.sqrt(s.common) * common + np.sqrt(1.0 - s.common) * own
        length = median * self.rng.lognormal(0.0, s.tail, (len(common), 1))
        return mixed * (length / np.linalg.norm(mixed, axis=1, keepdims=True))

    def _still(self, moved: Float64, index: int) -> Int64:
        """The Gaussians without new jitter: those that moved least, ties by calm regions."""
        order = np.lexsort((self.calm(self.rest, index)[:, 0], moved))
        return order[: round(self.statistics.same_positions * len(order))]


def _change_some(values: Float32, same: float, deviation: float, rng: np.random.Generator) -> None:
    """Add noise, in place, to all rows but a share `same`."""
    rows = np.flatnonzero(rng.random(len(values)) >= same)
    values[rows] += deviation * rng.standard_normal((len(rows), *values.shape[1:]), dtype=np.float32)


def noisy(
    frames: Iterable[GaussianCloud], seed: int, statistics: NoisyStatistics | None = None
) -> Iterator[GaussianCloud]:
    """*Tracked noisy*: 3DGStream's statistics on top of the clean motion; SH untouched.

    The 35 % that get no new jitter are those first that the clean sequence does not move: they are
    bit-identical if it does not move them, and follow it smoothly if it does.
    Where N changes (a cut), tracking starts anew.
    """
    rng = np.random.default_rng([seed, NOISY_STREAM])
    tracker: _NoisyTracker | None = None
    last: GaussianCloud | None = None
    for index, frame in enumerate(frames):
        if tracker is None or last is None or last.num_gaussians != frame.num_gaussians:
            tracker = _NoisyTracker(frame, rng, statistics or NoisyStatistics())
        else:
            moved = np.linalg.norm(frame.positions - last.positions, axis=1).astype(np.float64)
            tracker.advance(index, moved)
        last = frame
        yield tracker.observe(frame)


def drifting(
    frames: Iterable[GaussianCloud], seed: int, amplitudes: DriftAmplitudes | None = None
) -> Iterator[GaussianCloud]:
    """*All attributes change*: a slow drift, smooth in space, plus small noise on every value.

    Both scale with a magnitude that varies over space (log-normal), so that some regions hardly change.
    Where N changes (a cut), it starts anew.
    """
    a = amplitudes or DriftAmplitudes()
    rng = np.random.default_rng([seed, DRIFT_STREAM])
    rest: GaussianCloud | None = None
    for index, frame in enumerate(frames):
        if rest is None or rest.num_gaussians != frame.num_gaussians:
            rest = frame
            sizes = _amplitude_row(a, frame)
            drift = field_for(frame, rng, len(sizes), wavelength=a.wavelength, period=a.period)
            field = field_for(frame, rng, 1, wavelength=a.wavelength)
            magnitude = np.exp(a.spread * field(rest.positions))
        noise = rng.standard_normal((frame.num_gaussians, len(sizes)), dtype=np.float32)
        yield _shifted(frame, (drift(rest.positions, index) + a.noise * noise) * magnitude * sizes)


def _amplitude_row(a: DriftAmplitudes, cloud: GaussianCloud) -> Float64:
    """One amplitude per column of `_shifted`."""
    rest = 3 * cloud.sh_rest.shape[2]
    position = a.position * scene_size(cloud.positions)
    return np.repeat([position, a.rotation, a.scale, a.opacity, a.sh_dc, a.sh_rest], [3, 3, 3, 1, 3, rest])


def _shifted(frame: GaussianCloud, shift: Float64) -> GaussianCloud:
    """Add (N, 13 + 3 K) columns: position, rotation vector, log-scale, logit-opacity, SH."""
    turned = rotations.multiply(rotations.from_vectors(shift[:, 3:6]), frame.rotations)
    return GaussianCloud(
        positions=(frame.positions + shift[:, 0:3]).astype(np.float32),
        rotations=turned.astype(np.float32),
        scales=(frame.scales + shift[:, 6:9]).astype(np.float32),
        opacities=(frame.opacities + shift[:, 9]).astype(np.float32),
        sh_dc=(frame.sh_dc + shift[:, 10:13]).astype(np.float32),
        sh_rest=(frame.sh_rest + shift[:, 13:].reshape(frame.sh_rest.shape)).astype(np.float32),
    )
