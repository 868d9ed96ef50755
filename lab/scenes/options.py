"""What is common to all generated sequences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud


@dataclass(frozen=True)
class SceneOptions:
    """One sequence: `fps` frames a second; None keeps the number of Gaussians or SH degree of the source.

    Surfaces have neither of their own, and take 50 000 Gaussians of SH degree 2.
    """

    num_frames: int = 10
    num_gaussians: int | None = None
    sh_degree: int | None = None
    seed: int = 0
    fps: float = 30.0

    def __post_init__(self) -> None:
        if self.num_frames < 1 or self.fps <= 0.0:
            raise InputError(f"found {self.num_frames} frames at {self.fps} fps, expected 1 or more, above 0")
        if self.num_gaussians is not None and self.num_gaussians < 1:
            raise InputError(f"found {self.num_gaussians} Gaussians, expected at least 1")
        if self.sh_degree not in (None, 0, 1, 2, 3):
            raise InputError(f"found SH degree {self.sh_degree}, expected 0 to 3")

    @property
    def surface_gaussians(self) -> int:
        """How many Gaussians to sample on a surface."""
        return 50_000 if self.num_gaussians is None else self.num_gaussians

    @property
    def surface_sh_degree(self) -> int:
        """SH degree of Gaussians sampled on a surface."""
        return 2 if self.sh_degree is None else self.sh_degree


def reduce_cloud(cloud: GaussianCloud, options: SceneOptions) -> GaussianCloud:
    """A random subset of at most `num_gaussians` in the cloud's own order, with SH cut to `sh_degree`.

    Raises InputError where a higher SH degree is asked for than the cloud has.
    """
    degree = cloud.sh_degree if options.sh_degree is None else options.sh_degree
    if degree > cloud.sh_degree:
        raise InputError(f"the splat has SH degree {cloud.sh_degree}, {degree} was asked for; ask for less")
    if options.num_gaussians is not None and options.num_gaussians < cloud.num_gaussians:
        rng = np.random.default_rng(options.seed)
        cloud = cloud.take(np.sort(rng.choice(cloud.num_gaussians, options.num_gaussians, replace=False)))
    return replace(cloud, sh_rest=cloud.sh_rest[:, :, : SH_REST_COEFFICIENTS[degree]])
