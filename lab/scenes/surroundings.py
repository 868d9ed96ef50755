"""What captured scenes have around the thing that is looked at: walls, a far dome, floaters.

Scenes of one object have Gaussians of about one size. A room's walls are made of few and large ones, which
have most of the area and least of the detail; a codec that takes area for importance fails on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float64
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import rotations
from lab.scenes.fields import SmoothField, scene_size

#: keeps the random numbers apart from those of other stages with the same seed
SURROUNDINGS_STREAM = 43
#: of the room to the object; its walls have as many Gaussians as the object
ROOM_SIZE = 6.0
#: of the dome's Gaussians to the object's, and distances in sizes of the object
DOME_SHARE, DOME_NEAR, DOME_FAR = 0.05, 4.0, 12.0
#: the same of floaters, which are all about it, and their logits
HAZE_SHARE, HAZE_WIDTH, HAZE_LOGIT = 0.01, 0.6, -3.0
#: logits of what cannot be seen through, or hardly
_SOLID_LOGIT = 3.0
#: how much thinner than wide, logarithm
_THIN = 3.0


@dataclass(frozen=True)
class _Flat:
    """Places (n, 3), scene units, what flat Gaussians face, log-scales, that across first; mean logit."""

    positions: Float64
    normals: Float64
    log_scales: Float64
    logit: float


def _joined(cloud: GaussianCloud, flat: _Flat, rng: np.random.Generator) -> GaussianCloud:
    """`cloud`, then the flat Gaussians, in colours that change smoothly."""
    positions, normals = flat.positions, flat.normals
    count = len(positions)
    size = scene_size(cloud.positions)
    # half of the turn from the first axis to the normal, then any turn about it
    halfway = np.column_stack([1.0 + normals[:, 0], np.zeros(count), -normals[:, 2], normals[:, 1]])
    opposite = np.linalg.norm(halfway, axis=1) < 1e-3
    halfway[opposite] = (0.0, 0.0, 1.0, 0.0)
    about = rotations.from_vectors(rng.uniform(-np.pi, np.pi, (count, 1)) * np.array([1.0, 0.0, 0.0]))
    turns = rotations.multiply(rotations.normalised(halfway), about)
    colours = SmoothField(rng, 3, size)(positions) * 0.7 + rng.normal(0.0, 0.1, (count, 3))
    fresh = {
        "positions": positions,
        "rotations": turns,
        "scales": flat.log_scales - np.array([_THIN, 0.0, 0.0]),
        "opacities": rng.normal(flat.logit, 1.0, count),
        "sh_dc": colours,
        "sh_rest": rng.normal(0.0, 0.05, (count, *cloud.sh_rest.shape[1:])),
    }
    return replace(
        cloud,
        **{n: np.concatenate([getattr(cloud, n), values.astype(np.float32)]) for n, values in fresh.items()},
    )


def _middle(cloud: GaussianCloud) -> Float64:
    middle: Float64 = np.median(cloud.positions, axis=0).astype(np.float64)
    return middle


def _all_around(rng: np.random.Generator, count: int) -> Float64:
    """Unit vectors (count, 3) in all directions."""
    vectors = rng.standard_normal((count, 3))
    unit: Float64 = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def in_a_room(cloud: GaussianCloud, seed: int) -> GaussianCloud:
    """In the middle of a box whose walls are as many Gaussians as `cloud` has."""
    rng = np.random.default_rng([seed, SURROUNDINGS_STREAM])
    count, half = cloud.num_gaussians, 0.5 * ROOM_SIZE * scene_size(cloud.positions)
    which, axis = np.arange(count), rng.integers(0, 3, count)
    normals = np.zeros((count, 3))
    normals[which, axis] = rng.choice([-1.0, 1.0], count)
    positions = np.where(normals == 0.0, rng.uniform(-half, half, (count, 3)), half * normals)
    width = np.log(np.sqrt(6 * (2 * half) ** 2 / count))
    scales = width + rng.normal(0.0, 0.5, (count, 3))
    return _joined(cloud, _Flat(_middle(cloud) + positions, normals, scales, _SOLID_LOGIT), rng)


def under_a_dome(cloud: GaussianCloud, seed: int) -> GaussianCloud:
    """Few and very large ones far away, all around."""
    rng = np.random.default_rng([seed, SURROUNDINGS_STREAM])
    count = max(1, round(DOME_SHARE * cloud.num_gaussians))
    normals = _all_around(rng, count)
    distance = scene_size(cloud.positions) * rng.uniform(DOME_NEAR, DOME_FAR, (count, 1))
    scales = np.log(distance * rng.uniform(0.05, 0.3, (count, 3)))
    positions = _middle(cloud) + distance * normals
    return _joined(cloud, _Flat(positions, normals, scales, _SOLID_LOGIT), rng)


def in_a_haze(cloud: GaussianCloud, seed: int) -> GaussianCloud:
    """Large and nearly transparent floaters before it, behind it and in it."""
    rng = np.random.default_rng([seed, SURROUNDINGS_STREAM])
    count, size = max(1, round(HAZE_SHARE * cloud.num_gaussians)), scene_size(cloud.positions)
    normals = _all_around(rng, count)
    positions = _middle(cloud) + HAZE_WIDTH * size * rng.standard_normal((count, 3))
    scales = np.log(size * rng.uniform(0.2, 1.5, (count, 3)))
    return _joined(cloud, _Flat(positions, normals, scales, HAZE_LOGIT), rng)


SURROUNDINGS: dict[str, Callable[[GaussianCloud, int], GaussianCloud]] = {
    "room": in_a_room,
    "dome": under_a_dome,
    "haze": in_a_haze,
}
