"""A later frame: where the Gaussians of the frame before have gone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Float32, Int64
from dfcgs_codec.gaussians import GaussianCloud
from lab.render import View
from training.fitting.activity import NEIGHBOURS, THRESHOLD, activity
from training.fitting.adam import Adam, decayed
from training.fitting.deform import Deformation, turn_gradient, turned
from training.fitting.loss import loss_gradient

#: scene units or radians per step, at the first step; the last step has FINAL_SHARE of it
RATES = {"node_shift": 2e-3, "node_turn": 3e-3, "shift": 6e-4, "turn": 3e-3}
FINAL_SHARE = 0.05
#: per-Gaussian rates follow the activity, within these factors of its median
ACTIVITY_RANGE = (0.3, 2.0)
#: share of the last displacement that a frame starts with
MOMENTUM = 0.8
#: keeps the random numbers apart from those of other stages with the same seed
TRACK_STREAM = 54

Progress = Callable[[int, float], None]


@dataclass(frozen=True, eq=False)
class Moving:
    """The Gaussians that may move, in rising order, and their rates relative to the common one, (n, 1)."""

    rows: Int64
    rates: Float32


def moving_gaussians(cloud: GaussianCloud, views: Sequence[View], before: Sequence[View]) -> Moving:
    """Those that are active themselves or among active neighbours."""
    active = activity(cloud, views, before)
    count = min(NEIGHBOURS, cloud.num_gaussians)
    near = cKDTree(cloud.positions).query(cloud.positions, np.arange(1, count + 1))[1]
    around = np.median(active[near], axis=1)
    rows = np.flatnonzero(around > THRESHOLD)
    typical = np.median(around[rows]) if len(rows) else 1.0
    return Moving(rows, np.clip(around[rows] / typical, *ACTIVITY_RANGE)[:, None].astype(np.float32))


def track(
    cloud: GaussianCloud,
    last_step: Float32 | None,
    views: tuple[Sequence[View], Sequence[View]],
    steps: int,
    seed: tuple[int, int],
    progress: Progress | None = None,
) -> GaussianCloud:
    """The next frame's cloud: `cloud` with new positions and rotations where something moves.

    last_step: (N, 3) displacement that led to `cloud`, None for the first frame.
    views: the next frame's and the present one's. seed: that of the sequence, and the frame's index.
    """
    moving = moving_gaussians(cloud, *views)
    if not len(moving.rows):
        return cloud
    rng = np.random.default_rng([*seed, TRACK_STREAM])
    deformation = Deformation(cloud.positions[moving.rows], rng)
    if last_step is not None:
        deformation.values["shift"][:] = MOMENTUM * last_step[moving.rows]
    adam = Adam(deformation.values)
    moved = _moved(cloud, moving.rows, deformation)
    for step in range(steps):
        loss, gradient = loss_gradient(moved, views[0][rng.integers(len(views[0]))])
        by_turn = turn_gradient(moved.rotations[moving.rows], gradient.rotations[moving.rows])
        rates = _rates(moving, step / steps)
        adam.step(deformation.gradients(gradient.positions[moving.rows], by_turn), rates)
        moved = _moved(cloud, moving.rows, deformation)
        if progress is not None:
            progress(step, loss)
    return moved


def _rates(moving: Moving, progress: float) -> dict[str, float | Float32]:
    rates: dict[str, float | Float32] = {
        name: decayed(rate, FINAL_SHARE * rate, progress) for name, rate in RATES.items()
    }
    return rates | {name: np.float32(rates[name]) * moving.rates for name in ("shift", "turn")}


def _moved(cloud: GaussianCloud, rows: Int64, deformation: Deformation) -> GaussianCloud:
    displacement, turn = deformation.motion()
    positions, quaternions = cloud.positions.copy(), cloud.rotations.copy()
    positions[rows] += displacement.astype(np.float32)
    quaternions[rows] = turned(cloud.rotations[rows], turn)
    return replace(cloud, positions=positions, rotations=quaternions)
