"""All variants of a clean sequence, by name.

A variant takes frames and a seed, and yields frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import rotations
from lab.scenes.semi_tracked import semi_tracked, semi_tracked_with_ids
from lab.scenes.stress import STRESS
from lab.scenes.tracked import drifting, noisy

Variant = Callable[[Iterable[GaussianCloud], int], Iterator[GaussianCloud]]

#: keep the random numbers apart from those of other stages with the same seed
PERMUTED_STREAM, UNTRACKED_STREAM = 31, 32


def smooth(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """*Tracked smooth*: as it is."""
    del seed
    yield from frames


def permuted_with_ids(frames: Iterable[GaussianCloud], seed: int) -> Iterator[tuple[GaussianCloud, Int64]]:
    """As `permuted`, with the true identity (N,) of each Gaussian: equal in two frames = the same one."""
    rng = np.random.default_rng([seed, PERMUTED_STREAM])
    for frame, ids in semi_tracked_with_ids(frames, seed):
        order = rng.permutation(frame.num_gaussians)
        yield frame.take(order), ids[order]


def permuted(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """*Permuted*: semi-tracked, the order lost in each frame."""
    for frame, _ in permuted_with_ids(frames, seed):
        yield frame


def untracked(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """*Untracked*: each frame as if fitted alone, N within 10 % of the clean one and no correspondence.

    Gaussians are drawn with replacement and moved within their own extent, so that the surface stays while no
    Gaussian of another frame is found again.
    """
    rng = np.random.default_rng([seed, UNTRACKED_STREAM])
    for frame in frames:
        count = max(1, round(frame.num_gaussians * rng.uniform(0.9, 1.1)))
        yield _refitted(frame.take(rng.integers(0, frame.num_gaussians, count)), rng)


def _refitted(cloud: GaussianCloud, rng: np.random.Generator) -> GaussianCloud:
    """Independent noise on everything, positions along each Gaussian's own axes."""
    n = cloud.num_gaussians
    units = rotations.normalised(cloud.rotations)
    offset = rotations.rotate(units, np.exp(cloud.scales) * rng.standard_normal((n, 3)))
    turn = rotations.from_vectors(rng.normal(0.0, 0.15, (n, 3)))
    sign = rng.choice([-1.0, 1.0], (n, 1))
    return GaussianCloud(
        positions=(cloud.positions + offset).astype(np.float32),
        rotations=(sign * rotations.multiply(turn, cloud.rotations)).astype(np.float32),
        scales=(cloud.scales + rng.normal(0.0, 0.25, (n, 3))).astype(np.float32),
        opacities=(cloud.opacities + rng.normal(0.0, 0.7, n)).astype(np.float32),
        sh_dc=(cloud.sh_dc + rng.normal(0.0, 0.1, (n, 3))).astype(np.float32),
        sh_rest=(cloud.sh_rest + rng.normal(0.0, 0.04, cloud.sh_rest.shape)).astype(np.float32),
    )


#: every variant by its name on the command line
VARIANTS: dict[str, Variant] = {
    "smooth": smooth,
    "noisy": noisy,
    "drift": drifting,
    "semi": semi_tracked,
    "permuted": permuted,
    "untracked": untracked,
    **STRESS,
}
