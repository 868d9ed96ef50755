"""Frame 0: every attribute of a fixed number of Gaussians, from rough values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from lab.render import View
from training.fitting.adam import Adam, decayed
from training.fitting.capture import DISTANCE
from training.fitting.loss import loss_gradient
from training.fitting.sequences import FittedSequence, TrueFrame

#: learning rates of 3DGS; that of positions falls, and is a share of the size of the capture
POSITION_RATES = (1.6e-4 * DISTANCE, 1.6e-6 * DISTANCE)
RATES = {"rotations": 1e-3, "scales": 5e-3, "opacities": 0.025, "sh_dc": 2.5e-3, "sh_rest": 2.5e-3 / 20}
#: noise of the first values: positions (in distances of neighbours), log-scales, logits, f_dc
POSITION_NOISE, SCALE_NOISE, OPACITY_NOISE, COLOUR_NOISE = 0.3, 0.2, 0.3, 0.3
NEIGHBOURS = 3
#: keep the random numbers apart from those of other stages with the same seed
START_STREAM, FIRST_STREAM = 52, 53

Progress = Callable[[int, float], None]


def rough_cloud(truth: TrueFrame, sequence: FittedSequence) -> GaussianCloud:
    """A subset of the true Gaussians, shuffled and displaced; half transparent, of about their colours."""
    rng = np.random.default_rng([sequence.seed, START_STREAM])
    rows = rng.permutation(_subset(truth.is_character, sequence, rng))
    n, shape = len(rows), (len(rows), 3, SH_REST_COEFFICIENTS[sequence.sh_degree])
    points = truth.cloud.positions[rows].astype(np.float64)
    spacing = cKDTree(points).query(points, min(NEIGHBOURS + 1, n))[0][:, 1:].mean(axis=1, keepdims=True)
    arrays = (
        points + POSITION_NOISE * spacing * rng.standard_normal((n, 3)),
        rng.standard_normal((n, 4)),
        np.log(np.maximum(spacing, 1e-4)) + rng.normal(-0.3, SCALE_NOISE, (n, 3)),
        rng.normal(0.0, OPACITY_NOISE, n),
        truth.cloud.sh_dc[rows] + rng.normal(0.0, COLOUR_NOISE, (n, 3)),
        np.zeros(shape),
    )
    return GaussianCloud(*(np.ascontiguousarray(array, dtype=np.float32) for array in arrays))


def _subset(is_character: Bool, sequence: FittedSequence, rng: np.random.Generator) -> Int64:
    character, stage = np.flatnonzero(is_character), np.flatnonzero(~is_character)
    return np.concatenate(
        [
            rng.choice(character, sequence.character, replace=False),
            rng.choice(stage, sequence.stage, replace=False),
        ]
    )


def fit_first(
    start: GaussianCloud, views: Sequence[View], steps: int, seed: int, progress: Progress | None = None
) -> GaussianCloud:
    """The cloud after `steps` steps of Adam from `start`, one random view each.

    progress: called with the step and its loss.
    """
    rng = np.random.default_rng([seed, FIRST_STREAM])
    values = {field.name: getattr(start, field.name).copy() for field in fields(start)}
    adam = Adam(values)
    for step in range(steps):
        view = views[rng.integers(len(views))]
        loss, gradient = loss_gradient(GaussianCloud(**values), view)
        rates = {"positions": decayed(*POSITION_RATES, step / steps), **RATES}
        adam.step(gradient._asdict(), rates)
        if progress is not None:
            progress(step, loss)
    return GaussianCloud(**values)
