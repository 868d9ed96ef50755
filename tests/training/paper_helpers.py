"""Small moving clouds, prepared as training wants them, in a second and without assets."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import make_cloud
from training.paper.gof import NUM_FRAMES, Gof
from training.paper.prepare import prepare_gof


def moving_clouds(count: int = 700, seed: int = 0, sh_degree: int = 1) -> list[GaussianCloud]:
    """A cloud that sways: smooth motion of position, a turn of rotation."""
    first = make_cloud(count, sh_degree, seed)
    wave = np.sin(first.positions @ np.array([[0.0, 1.0, 0.5], [1.0, 0.0, 0.3], [0.2, 0.7, 0.0]], np.float32))
    turn = np.array([0.0, 0.02, 0.01, 0.0], np.float32)
    return [
        replace(
            first,
            positions=first.positions + np.float32(0.05 * t) * wave,
            rotations=first.rotations + np.float32(t) * turn,
        )
        for t in range(NUM_FRAMES)
    ]


@cache
def small_gof(seed: int = 0) -> Gof:
    """Prepared, without pictures."""
    return prepare_gof(moving_clouds(seed=seed), 22.0, "+y", num_views=0)


def small_data(folder: Path, num_gofs: int = 2) -> Path:
    """A folder of such GoFs."""
    for seed in range(num_gofs):
        small_gof(seed).save(folder / f"sway.{seed}.npz")
    return folder
