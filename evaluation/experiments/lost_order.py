"""Scenes of the list with births and deaths, in order and with the order lost, and who is who in truth.

Scenes that have births and deaths of their own keep them. In the others 1 % of the Gaussians die in each
frame and as many are born, as densification does it: beside a living one, with its colours, smaller and
fainter, and from then on fixed to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from itertools import islice
from typing import TypeVar

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.gaussians import GaussianCloud
from lab.assets import find_asset
from lab.scenes import rotations
from lab.scenes.catalogue import Scene
from lab.scenes.semi_tracked import SemiTrackedStatistics, semi_tracked_with_ids
from lab.scenes.tracked import DriftAmplitudes, NoisyStatistics, drifting, noisy

#: frames, and their true identities (N,): equal in two frames = the same Gaussian
Identified = Iterator[tuple[GaussianCloud, Int64]]
_S = TypeVar("_S", NoisyStatistics, DriftAmplitudes, SemiTrackedStatistics)

#: share of the Gaussians that die in a frame, and share that are born
TURNOVER = 0.01
#: what is measured of a scene: its noise, three times its noise, and changes of every attribute instead
OWN, THREEFOLD, DRIFT, DRIFT_THREEFOLD = "own", "own x 3", "drift", "drift x 3"
NOISES = (OWN, THREEFOLD, DRIFT, DRIFT_THREEFOLD)
_FACTOR = 3.0
#: what of the generator's statistics are sizes of changes
_SIZES = {"jitter", "turn", "scale_change", "opacity_change"}
_SIZES |= {"position", "rotation", "scale", "opacity", "sh_dc", "sh_rest"}
_WITH_TURNOVER = ("semi", "permuted")
#: keep the random numbers apart from those of the generator's stages with the same seed
_TURNOVER_STREAM, _ORDER_STREAM = 51, 52


class _Population:
    """The living: row of the scene each one came from, its id, and what sets it apart from that row.

    Columns of `marks`: offset along the row's axes in units of their lengths, rotation vector, change of
    log-scales, of logit-opacity; all zero for the row itself.
    """

    def __init__(self, count: int, seed: int) -> None:
        self.rng = np.random.default_rng([seed, _TURNOVER_STREAM])
        self.origin: Int64 = np.arange(count)
        self.ids: Int64 = np.arange(count)
        self.next_id = count
        self.marks = np.zeros((count, 10))

    def advance(self) -> None:
        """Deaths anywhere; births beside survivors, appended."""
        count = len(self.ids)
        deaths, births = (int(self.rng.binomial(count, TURNOVER)) for _ in range(2))
        alive = np.sort(self.rng.permutation(count)[min(deaths, count - 1) :])
        parents = self.rng.choice(alive, births)
        self.origin = self.origin[np.concatenate([alive, parents])]
        self.ids = np.concatenate([self.ids[alive], self.next_id + np.arange(births)])
        self.marks = np.concatenate([self.marks[alive], self._new_marks(births)])
        self.next_id += births

    def _new_marks(self, births: int) -> Float64:
        noise = self.rng.standard_normal((births, 10))
        noise[:, 3:] *= [0.2, 0.2, 0.2, 0.1, 0.1, 0.1, 0.3]
        return noise - [0, 0, 0, 0, 0, 0, 0.3, 0.3, 0.3, 1.0]

    def of(self, frame: GaussianCloud) -> GaussianCloud:
        """The living in a frame of the scene."""
        parents = frame.take(self.origin)
        born = self.marks.any(axis=1)
        marks = self.marks[born]
        changed = {f.name: getattr(parents, f.name).copy() for f in fields(parents)}
        old = changed["rotations"][born]
        offset = np.exp(changed["scales"][born].astype(np.float64)) * marks[:, :3]
        changed["positions"][born] += rotations.rotate(rotations.normalised(old), offset)
        changed["rotations"][born] = rotations.multiply(old, rotations.from_vectors(marks[:, 3:6]))
        changed["scales"][born] += marks[:, 6:9]
        changed["opacities"][born] += marks[:, 9]
        return GaussianCloud(**changed)


def with_turnover(frames: Iterable[GaussianCloud], seed: int) -> Identified:
    """`frames`, of constant N and order, with births and deaths; survivors keep their order."""
    population: _Population | None = None
    for frame in frames:
        if population is None:
            population = _Population(frame.num_gaussians, seed)
        else:
            population.advance()
        yield population.of(frame), population.ids


def order_lost(frames: Identified, seed: int) -> Identified:
    """Each frame in a random order of its own."""
    rng = np.random.default_rng([seed, _ORDER_STREAM])
    for frame, ids in frames:
        order = rng.permutation(frame.num_gaussians)
        yield frame.take(order), ids[order]


def _threefold(statistics: _S) -> _S:
    names = {f.name for f in fields(statistics)} & _SIZES
    return replace(statistics, **{name: _FACTOR * getattr(statistics, name) for name in names})


def noises(scene: Scene) -> tuple[str, ...]:
    """What can be measured of a scene: three times no noise is none, and births are of one kind only."""
    if scene.variant == "untracked":
        return (OWN,)
    return {"smooth": (OWN, DRIFT, DRIFT_THREEFOLD), "noisy": NOISES}.get(scene.variant, (OWN, THREEFOLD))


def tracked(scene: Scene, noise: str = OWN) -> Iterator[GaussianCloud]:
    """The scene under a noise, without any births and deaths but its own."""
    asset = find_asset(scene.asset)
    if noise == OWN:
        return scene.frames(asset)
    clean = replace(scene, variant="smooth").frames(asset)
    if noise == THREEFOLD and scene.variant == "noisy":
        return noisy(clean, scene.seed, _threefold(NoisyStatistics()))
    return drifting(clean, scene.seed, DriftAmplitudes() if noise == DRIFT else _threefold(DriftAmplitudes()))


def in_order(scene: Scene, noise: str, num_frames: int) -> Identified:
    """The first frames of the scene under a noise, with births and deaths, the order kept."""
    if scene.variant == "untracked":
        return _strangers(islice(tracked(scene), num_frames))
    if scene.variant in _WITH_TURNOVER:
        clean = replace(scene, variant="smooth").frames(find_asset(scene.asset))
        statistics = SemiTrackedStatistics() if noise == OWN else _threefold(SemiTrackedStatistics())
        return islice(semi_tracked_with_ids(clean, scene.seed, statistics), num_frames)
    return with_turnover(islice(tracked(scene, noise), num_frames), scene.seed)


def _strangers(frames: Iterable[GaussianCloud]) -> Identified:
    """No Gaussian is one of another frame."""
    total = 0
    for frame in frames:
        yield frame, total + np.arange(frame.num_gaussians)
        total += frame.num_gaussians
