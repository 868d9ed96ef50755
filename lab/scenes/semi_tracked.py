"""Semi-tracked sequences (QUEEN, HiCoM): most Gaussians stand still, the rest change in every attribute.

Statistics are those of evidence.md section 2 and hold from one frame to the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import rotations
from lab.scenes.fields import field_for, scene_size

#: keeps the random numbers apart from those of other stages with the same seed
SEMI_TRACKED_STREAM = 21


@dataclass(frozen=True)
class SemiTrackedStatistics:
    """Shares of the Gaussians per frame, then the standard deviations of what changes."""

    #: least and most Gaussians that change
    active: tuple[float, float] = (0.07, 0.10)
    births: float = 0.005
    deaths: float = 0.005
    position: float = 5e-4  # share of the scene's size
    rotation: float = 0.02  # radians
    scale: float = 0.02
    opacity: float = 0.1
    sh_dc: float = 0.02
    sh_rest: float = 0.01
    #: share of its distance to the clean attributes that a changed Gaussian takes back
    pull: float = 0.1


class _SemiTracker:
    """The living Gaussians: state, the clean Gaussian each one came from, and an id that never returns."""

    def __init__(
        self, first: GaussianCloud, rng: np.random.Generator, statistics: SemiTrackedStatistics
    ) -> None:
        self.statistics, self.rng = statistics, rng
        self.state, self.clean = first, first
        self.origin: Int64 = np.arange(first.num_gaussians)
        self.ids: Int64 = np.arange(first.num_gaussians)
        self.next_id = first.num_gaussians
        self.activity = np.zeros(first.num_gaussians)
        self.was_active = np.zeros(first.num_gaussians)
        self.size = scene_size(first.positions)
        self.region = field_for(first, rng, 1, wavelength=0.4, period=200.0)

    def advance(self, index: int, clean: GaussianCloud) -> None:
        """One frame on: `clean` is the clean sequence's frame `index`."""
        if clean.num_gaussians != self.clean.num_gaussians:
            raise InputError(
                f"frame {index}: {clean.num_gaussians} Gaussians, frame {index - 1} has "
                f"{self.clean.num_gaussians}; semi-tracked variants start from sequences with fixed N"
            )
        active = self._choose_active(index, clean)
        self.state = self._changed(active, clean)
        self.clean = clean
        self._replace_some(active)

    def _choose_active(self, index: int, clean: GaussianCloud) -> Int64:
        """Those the clean sequence moves most, with some inertia; a wandering region if nothing moves."""
        motion = np.linalg.norm(clean.positions - self.clean.positions, axis=1)[self.origin]
        self.activity = 0.8 * self.activity + motion
        score = self.activity / (self.activity.max() or 1.0) + 0.1 * self.was_active
        score += 0.05 * self.region(self.state.positions, index)[:, 0]
        count = max(1, round(self.rng.uniform(*self.statistics.active) * len(score)))
        active = np.sort(np.argpartition(-score, count - 1)[:count])
        self.was_active[:] = 0.0
        self.was_active[active] = 1.0
        return active

    def _changed(self, active: Int64, clean: GaussianCloud) -> GaussianCloud:
        """The state after `active` took the clean sequence's step, plus noise on everything."""
        s, old, source = self.statistics, self.state, self.origin[active]
        step = clean.positions[source].astype(np.float64) - self.clean.positions[source]
        step += self._noise(s.position * self.size, (len(active), 3))
        before = self.clean.rotations[source].astype(np.float64)
        turn = rotations.multiply(clean.rotations[source], rotations.conjugate(before))
        # conjugate is the inverse only of unit quaternions; splats need not have those
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        turn = rotations.multiply(rotations.from_vectors(self._noise(s.rotation, (len(active), 3))), turn)
        new = {f.name: getattr(old, f.name).copy() for f in fields(old)}
        new["positions"][active] += step
        new["rotations"][active] = rotations.multiply(turn, old.rotations[active])
        for name, deviation in _PLAIN.items():
            target, value = getattr(clean, name)[source], new[name][active]
            noise = self._noise(getattr(s, deviation), value.shape)
            new[name][active] = value + s.pull * (target - value) + noise
        return GaussianCloud(**new)

    def _noise(self, deviation: float, shape: tuple[int, ...]) -> Float64:
        return deviation * self.rng.standard_normal(shape)

    def _replace_some(self, active: Int64) -> None:
        """Deaths anywhere; births beside active Gaussians, appended, faint and smaller than their parent."""
        n = self.state.num_gaussians
        deaths = min(self.rng.binomial(n, self.statistics.deaths), n - 1)
        births = int(self.rng.binomial(n, self.statistics.births))
        parents = self.rng.choice(active, births)
        children = self._children(self.state.take(parents))
        alive = np.sort(self.rng.permutation(n)[deaths:])
        kept = np.concatenate([alive, parents])
        self.state = concatenate(self.state.take(alive), children)
        self.origin, self.activity, self.was_active = (
            a[kept] for a in (self.origin, self.activity, self.was_active)
        )
        self.ids = np.concatenate([self.ids[alive], self.next_id + np.arange(births)])
        self.next_id += births

    def _children(self, parents: GaussianCloud) -> GaussianCloud:
        n = parents.num_gaussians
        units = rotations.normalised(parents.rotations)
        offset = rotations.rotate(units, np.exp(parents.scales) * self.rng.standard_normal((n, 3)))
        turn = rotations.from_vectors(self._noise(0.2, (n, 3)))
        return replace(
            parents,
            positions=(parents.positions + offset).astype(np.float32),
            rotations=rotations.multiply(turn, parents.rotations).astype(np.float32),
            scales=(parents.scales - 0.3 + self._noise(0.1, (n, 3))).astype(np.float32),
            opacities=(parents.opacities - 1.0 + self._noise(0.3, (n,))).astype(np.float32),
        )


#: attributes that change by addition, and the statistic that says how much
_PLAIN = {"scales": "scale", "opacities": "opacity", "sh_dc": "sh_dc", "sh_rest": "sh_rest"}


def concatenate(first: GaussianCloud, second: GaussianCloud) -> GaussianCloud:
    """All Gaussians of `first`, then all of `second`; both of one SH degree."""
    names = [f.name for f in fields(first)]
    return GaussianCloud(**{n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in names})


def semi_tracked_with_ids(
    frames: Iterable[GaussianCloud], seed: int, statistics: SemiTrackedStatistics | None = None
) -> Iterator[tuple[GaussianCloud, Int64]]:
    """As `semi_tracked`, with the true identity (N,) of each Gaussian: equal in two frames = the same one."""
    rng = np.random.default_rng([seed, SEMI_TRACKED_STREAM])
    tracker: _SemiTracker | None = None
    for index, frame in enumerate(frames):
        if tracker is None:
            tracker = _SemiTracker(frame, rng, statistics or SemiTrackedStatistics())
        else:
            tracker.advance(index, frame)
        yield tracker.state, tracker.ids


def semi_tracked(
    frames: Iterable[GaussianCloud], seed: int, statistics: SemiTrackedStatistics | None = None
) -> Iterator[GaussianCloud]:
    """*Semi-tracked*: 90-93 % bit-identical to the frame before, the rest changed in all attributes.

    0.5 % die and 0.5 % are born in each frame; survivors keep their order, the newborn are appended. What
    stands still does not follow the clean sequence, and later moves on from where it stands.
    """
    for frame, _ in semi_tracked_with_ids(frames, seed, statistics):
        yield frame
