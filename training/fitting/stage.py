"""What stands still around the character: a tiled ground and a few boulders, as Gaussians."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from dfcgs_codec.array_types import Float64
from dfcgs_codec.gaussians import GaussianCloud
from lab.meshes import appearance
from lab.scenes import rotations
from lab.scenes.fields import SmoothField

#: scene units, as of the KayKit characters, which are 2.4 tall and stand at the origin
GROUND_RADIUS = 2.1
BOULDER_RING = 1.75
NUM_BOULDERS = 7
BOULDER_RADIUS = (0.18, 0.38)
TILE = 0.45
#: share of the Gaussians that are on the ground
GROUND_SHARE = 0.7
#: as of the sampled surfaces of `lab.scenes.animated`
FLATNESS = -2.0
OPACITY = (2.0, 1.5)
#: keeps the random numbers apart from those of other stages with the same seed
STAGE_STREAM = 51

_UP = np.array([0.0, 1.0, 0.0])


def stage_cloud(count: int, sh_degree: int, seed: int) -> GaussianCloud:
    """`count` Gaussians on the ground and the boulders, in random order."""
    rng = np.random.default_rng([seed, STAGE_STREAM])
    on_ground = round(GROUND_SHARE * count)
    ground, boulders = _ground(on_ground, rng), _boulders(count - on_ground, rng)
    spacing = np.repeat([_spacing(ground[0]), _spacing(boulders[0])], [on_ground, count - on_ground])
    points, normals, colours = (np.concatenate(pair) for pair in zip(ground, boulders, strict=True))
    cloud = _surface(points, normals, colours, spacing, (sh_degree, rng))
    return cloud.take(rng.permutation(count))


def join(*clouds: GaussianCloud) -> GaussianCloud:
    """All Gaussians of several clouds of one SH degree, in that order."""
    names = [field.name for field in fields(GaussianCloud)]
    return GaussianCloud(*(np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in names))


def _ground(count: int, rng: np.random.Generator) -> tuple[Float64, Float64, Float64]:
    """Points, normals and linear colours (n, 3) of a disc of tiles."""
    radius, angle = GROUND_RADIUS * np.sqrt(rng.random(count)), rng.uniform(0.0, 2.0 * np.pi, count)
    points = np.stack([radius * np.cos(angle), np.zeros(count), radius * np.sin(angle)], axis=1)
    tile = np.floor(points[:, [0, 2]] / TILE).astype(np.int64)
    shade = 0.12 + 0.25 * ((tile.sum(axis=1) % 2) + rng.random((32, 32))[tile[:, 0], tile[:, 1]] * 0.5)
    colours = shade[:, None] * np.array([1.0, 0.85, 0.65]) * _mottle(points, rng)
    return points, np.broadcast_to(_UP, points.shape), colours


def _boulders(count: int, rng: np.random.Generator) -> tuple[Float64, Float64, Float64]:
    """Points, normals and linear colours (n, 3) of hemispheres on the ground."""
    angle = 2.0 * np.pi * (np.arange(NUM_BOULDERS) + rng.uniform(-0.25, 0.25, NUM_BOULDERS)) / NUM_BOULDERS
    centres = BOULDER_RING * np.stack([np.cos(angle), np.zeros(NUM_BOULDERS), np.sin(angle)], axis=1)
    radii = rng.uniform(*BOULDER_RADIUS, NUM_BOULDERS)
    tints = rng.uniform(0.08, 0.5, (NUM_BOULDERS, 3))
    which = rng.choice(NUM_BOULDERS, count, p=radii**2 / (radii**2).sum())
    normals = rng.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:, 1] = np.abs(normals[:, 1])
    points = centres[which] + radii[which, None] * normals
    return points, normals, tints[which] * _mottle(points, rng)


def _mottle(points: Float64, rng: np.random.Generator) -> Float64:
    """(n, 3) factors around 1: tints coarser than a tile, grain finer than one."""
    tint, grain = SmoothField(rng, 3, 1.5), SmoothField(rng, 1, 0.15)
    return np.exp(0.12 * tint(points) + 0.3 * grain(points))


def _spacing(points: Float64) -> float:
    """Typical distance of neighbours, from the area of ground or hemispheres that `points` cover."""
    low, high = points.min(axis=0), points.max(axis=0)
    return float(np.sqrt(np.prod((high - low)[[0, 2]]) / (2.0 * len(points))))


def _surface(
    points: Float64,
    normals: Float64,
    colours: Float64,
    spacing: Float64,
    look: tuple[int, np.random.Generator],
) -> GaussianCloud:
    """Flat Gaussians in the surface; `look`: SH degree and the source of random numbers."""
    sh_degree, rng = look
    count = len(points)
    # any tangent will do; the sideways vector is never along a normal by chance
    tangents = np.cross(normals, rng.standard_normal((count, 3)))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    frames = np.stack([tangents, np.cross(normals, tangents), normals], axis=2)
    scales = np.log(spacing)[:, None] + rng.normal(-0.2, 0.3, (count, 3))
    scales[:, 2] += FLATNESS
    arrays = (
        points,
        rotations.from_matrices(frames),
        scales,
        rng.normal(*OPACITY, count),
        appearance.sh_dc(np.clip(colours, 0.0, 1.0), normals),
        appearance.sh_rest(normals, sh_degree, rng),
    )
    return GaussianCloud(*(np.ascontiguousarray(array, dtype=np.float32) for array in arrays))
