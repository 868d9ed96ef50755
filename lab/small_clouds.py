"""Small clouds and sequences, the same on every machine: what tests and conformance streams are made of."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from dfcgs_codec.array_types import Float32
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.ply import read_ply
from lab.record import REPOSITORY

ASSET = REPOSITORY / "assets" / "playbot_31k_sh2.ply"
FIELDS = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")


def make_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """Independent Gaussians in a ball of radius about 2, sizes around exp(-4)."""
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> Float32:
        return rng.normal(size=shape).astype(np.float32)

    return GaussianCloud(
        positions=normal(n, 3),
        rotations=normal(n, 4),
        scales=normal(n, 3) * np.float32(0.5) - 4,
        opacities=normal(n) * 2,
        sh_dc=normal(n, 3),
        sh_rest=normal(n, 3, SH_REST_COEFFICIENTS[sh_degree]) * np.float32(0.1),
    )


def clustered_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """A few dense clusters whose members resemble each other, as in trained scenes."""
    rng = np.random.default_rng(seed)
    centers, own = make_cloud(8, sh_degree, seed), make_cloud(n, sh_degree, seed + 1)
    cluster = centers.take(rng.integers(0, 8, n))
    mixed = {f: getattr(cluster, f) + np.float32(0.1) * getattr(own, f) for f in FIELDS}
    return replace(GaussianCloud(**mixed), scales=cluster.scales + np.float32(0.1) * (own.scales + 4))


def coincident_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """All Gaussians at one point."""
    cloud = make_cloud(n, sh_degree, seed)
    return replace(cloud, positions=np.full((n, 3), 0.25, np.float32))


def with_outliers(cloud: GaussianCloud, count: int, factor: float = 1000.0) -> GaussianCloud:
    """The first `count` Gaussians are `factor` times as far out."""
    positions = cloud.positions.copy()
    positions[:count] *= np.float32(factor)
    return replace(cloud, positions=positions)


@cache
def _asset() -> GaussianCloud:
    return read_ply(ASSET)[0]


def real_cloud(n: int) -> GaussianCloud:
    """Every k-th Gaussian of the asset."""
    cloud = _asset()
    return cloud.take(np.linspace(0, cloud.num_gaussians - 1, n).astype(np.int64))


def on_lattices(cloud: GaussianCloud) -> GaussianCloud:
    """As SPZ leaves it."""
    steps = {"positions": 2.0**-12, "scales": 2.0**-4, "sh_rest": 2.0**-4}
    arrays = {name: np.rint(getattr(cloud, name) / step) * step for name, step in steps.items()}
    return replace(cloud, **{name: array.astype(np.float32) for name, array in arrays.items()})


def same_cloud(a: GaussianCloud, b: GaussianCloud) -> bool:
    """Equal bit for bit."""
    return all(getattr(a, f).tobytes() == getattr(b, f).tobytes() for f in FIELDS)


def swaying(cloud: GaussianCloud, count: int, amount: float = 0.04) -> list[GaussianCloud]:
    """Everything leans to one side, the farther up the more, and back."""
    up = cloud.positions[:, 1] - cloud.positions[:, 1].min()
    frames = []
    for index in range(count):
        positions = cloud.positions.copy()
        positions[:, 0] += np.float32(amount * np.sin(index)) * up
        frames.append(replace(cloud, positions=positions))
    return frames


def still(cloud: GaussianCloud, num_frames: int) -> list[GaussianCloud]:
    """The same frame again and again."""
    return [cloud] * num_frames


def drifting(cloud: GaussianCloud, num_frames: int, speed: float = 0.01) -> list[GaussianCloud]:
    """A tracked sequence: all Gaussians with x > 0 move along y, the others stand still."""
    moving = cloud.positions[:, :1] > 0
    step = np.array([0, speed, 0], np.float32)
    return [
        replace(cloud, positions=np.where(moving, cloud.positions + step * np.float32(i), cloud.positions))
        for i in range(num_frames)
    ]


def waving(cloud: GaussianCloud, angle: float) -> GaussianCloud:
    """The Gaussians with x > 0.2 turned by `angle` radians about the vertical axis."""
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    moving = cloud.positions[:, :1] > 0.2
    turned = turn * Rotation.from_quat(cloud.rotations, scalar_first=True)
    return replace(
        cloud,
        positions=np.where(moving, turn.apply(cloud.positions), cloud.positions).astype(np.float32),
        rotations=np.where(moving, turned.as_quat(scalar_first=True), cloud.rotations).astype(np.float32),
    )


def joined(first: GaussianCloud, second: GaussianCloud) -> GaussianCloud:
    """All Gaussians of both."""
    return GaussianCloud(**{f: np.concatenate([getattr(first, f), getattr(second, f)]) for f in FIELDS})


def succeeding(
    cloud: GaussianCloud, num_frames: int, *, angle: float = 0.05, share: float = 0.03, shuffle: bool = False
) -> list[GaussianCloud]:
    """Part of the Gaussians turns; with each frame a share goes and as many others come."""
    rng = np.random.default_rng(num_frames)
    count = max(1, round(share * cloud.num_gaussians))
    frames = [cloud]
    for index in range(1, num_frames):
        kept = np.sort(rng.permutation(cloud.num_gaussians)[count:])
        fresh = make_cloud(count, cloud.sh_degree, 1000 + index)
        fresh = replace(fresh, scales=fresh.scales + (cloud.scales.mean() + 4))
        cloud = joined(waving(cloud.take(kept), angle), fresh)
        frames.append(cloud.take(rng.permutation(cloud.num_gaussians)) if shuffle else cloud)
    return frames


def travelling(cloud: GaussianCloud, num_frames: int, speed: float = 0.1) -> list[GaussianCloud]:
    """A tracked sequence in which the whole scene moves along x, far beyond its own size in the end."""
    step = np.array([speed, 0, 0], np.float32)
    return [replace(cloud, positions=cloud.positions + step * np.float32(i)) for i in range(num_frames)]


def all_changing(cloud: GaussianCloud, num_frames: int, seed: int = 5) -> list[GaussianCloud]:
    """A semi-tracked sequence: every attribute of every Gaussian walks at random."""
    frames = [cloud]
    for i in range(1, num_frames):
        noise, last = make_cloud(cloud.num_gaussians, cloud.sh_degree, seed + i), frames[-1]
        moved = {f: getattr(last, f) + np.float32(0.02) * getattr(noise, f) for f in FIELDS}
        moved["scales"] = last.scales + np.float32(0.02) * (noise.scales + 4)
        frames.append(GaussianCloud(**moved))
    return frames


def untracked(n: int, num_frames: int, sh_degree: int = 0) -> list[GaussianCloud]:
    """Nothing corresponds."""
    return [make_cloud(n, sh_degree, 100 + i) for i in range(num_frames)]


def shuffled(cloud: GaussianCloud, seed: int = 3) -> GaussianCloud:
    """The same Gaussians in another order."""
    return cloud.take(np.random.default_rng(seed).permutation(cloud.num_gaussians))
