"""A room of opaque walls with viewers in it: what is inside shows, what is behind the walls does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dfcgs_codec import GaussianCloud
from dfcgs_codec.array_types import Floats
from dfcgs_codec.views.camera import ViewCamera, Views
from lab.small_clouds import joined, make_cloud

#: Gaussians along a side of a wall; walls stand at -1 and 1
SIDE = 14
NUM_WALLS = 6 * SIDE * SIDE
#: turns that make the third axis x, y or z
_TURNS = np.array([[1, 0, 1, 0], [1, -1, 0, 0], [1, 0, 0, 0]], np.float32)


def looking(
    position: Sequence[float],
    target: Sequence[float],
    size: tuple[int, int] = (160, 120),
    focal: float = 100.0,
) -> ViewCamera:
    """A camera at `position` with `target` in the middle of its image."""
    there = np.array(position, float)
    forward = np.array(target, float) - there
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.1, 0.9, 0.3))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ there
    return ViewCamera(*size, focal, focal, size[0] / 2, size[1] / 2, pose)


def gaussians(positions: Floats, deviation: float, alpha: float, seed: int = 0) -> GaussianCloud:
    """Coloured balls of that size and opacity at `positions` (N, 3)."""
    cloud = make_cloud(len(positions), 0, seed)
    return replace(
        cloud,
        positions=positions.astype(np.float32),
        scales=np.full_like(cloud.scales, np.log(deviation)),
        opacities=np.full_like(cloud.opacities, np.log(alpha / (1 - alpha))),
        sh_dc=np.clip(cloud.sh_dc, -1.5, 1.5),
    )


def walls() -> GaussianCloud:
    """Six opaque walls of flat Gaussians."""
    across = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    u, v = (grid.ravel() for grid in np.meshgrid(across, across))
    positions, turns = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            wall = np.insert(np.stack([u, v], axis=1), axis, side, axis=1)
            positions.append(wall)
            turns.append(np.repeat(_TURNS[axis : axis + 1], len(wall), axis=0))
    cloud = gaussians(np.concatenate(positions), 0.9 * 2 / SIDE, 0.995, seed=5)
    scales = cloud.scales.copy()
    scales[:, 2] -= np.float32(np.log(30))
    return replace(cloud, scales=scales, rotations=np.concatenate(turns))


def inside(count: int = 40) -> GaussianCloud:
    """Balls in the room."""
    return gaussians(np.random.default_rng(1).uniform(-0.5, 0.5, (count, 3)), 0.06, 0.9, seed=1)


def behind(count: int = 60) -> GaussianCloud:
    """Balls behind the walls."""
    points = np.random.default_rng(2).normal(size=(count, 3))
    points *= 2.6 / np.linalg.norm(points, axis=1, keepdims=True)
    return gaussians(points, 0.06, 0.9, seed=2)


def room() -> GaussianCloud:
    """Walls, then what is inside, then what is behind."""
    return joined(joined(walls(), inside()), behind())


def viewers() -> Views:
    """Eight cameras in the room, near its middle, that look to all sides."""
    found = []
    for index in range(8):
        angle = 2 * np.pi * index / 8
        out = np.array([np.cos(angle), 0.5 * (-1) ** index, np.sin(angle)])
        found.append(looking(-0.75 * out, 0.9 * out))
    return Views(tuple(found))
