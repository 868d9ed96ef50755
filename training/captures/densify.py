"""Densification and pruning as in 3DGS (Kerbl et al. 2023, section 5.2), on Adam's arrays.

A Gaussian that the images pull about is cloned where it is small and split in two where it is large; what is
nearly transparent goes. Floaters and huge Gaussians in the background stay, as they do in captures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Int64
from lab.render import Camera, CloudGradient
from lab.scenes import rotations
from training.fitting.adam import Adam

#: mean gradient by the place in the image, whose half width and height are 1, above which a Gaussian is dense
GRADIENT = 1.2e-4
#: share of the size of the capture: larger Gaussians are split, smaller ones cloned
SPLIT_SIZE = 0.01
#: the halves of a split Gaussian are smaller by this factor
SHRINK = 1.6
#: opacities: below the first a Gaussian goes, a reset takes all others down to the second
FAINT, RESET = 0.005, 0.01


@dataclass
class Pull:
    """How strongly the images pull at each Gaussian: sums (N,) over the steps in which it was drawn."""

    total: Float32
    count: Float32

    @classmethod
    def none(cls, count: int) -> Pull:
        """For `count` Gaussians that nothing has pulled at yet."""
        return cls(np.zeros(count, np.float32), np.zeros(count, np.float32))

    def add(self, positions: Float32, gradient: CloudGradient, camera: Camera) -> None:
        """Count one step's gradient in; positions: (N, 3), those it was taken at."""
        drawn = gradient.opacities != 0.0
        self.total[drawn] += image_gradient(positions[drawn], gradient.positions[drawn], camera)
        self.count[drawn] += 1.0

    @property
    def mean(self) -> Float32:
        """(N,) per step; 0 for what was never drawn."""
        return self.total / np.maximum(self.count, np.float32(1.0))


def image_gradient(positions: Float32, gradient: Float32, camera: Camera) -> Float32:
    """(n,) length of the gradient by the place in the image (half width and height 1).

    Taken back from the gradient by the positions, (n, 3): a step across the line of sight moves the image by
    focal length / depth pixels.
    """
    rotation = camera.world_to_camera[:3, :3]
    depth = positions @ rotation[2] + camera.world_to_camera[2, 3]
    across, upright = gradient @ rotation[0], gradient @ rotation[1]
    horizontal = across * depth / camera.fx * (0.5 * camera.width)
    vertical = upright * depth / camera.fy * (0.5 * camera.height)
    return np.hypot(horizontal, vertical).astype(np.float32)


def densify(adam: Adam, pull: Pull, size: float, most: int, rng: np.random.Generator) -> None:
    """Clone, split and prune in place; at most `most` Gaussians are left, those pulled at most are densified.

    size: of the capture, scene units.
    """
    values = adam.values
    opacity = 1.0 / (1.0 + np.exp(-values["opacities"].astype(np.float64)))
    keep = opacity >= FAINT
    room = most - int(keep.sum())
    wanted = np.flatnonzero(keep & (pull.mean > GRADIENT))
    wanted = wanted[np.argsort(-pull.mean[wanted], kind="stable")][: max(room, 0)]
    large = np.exp(values["scales"][wanted]).max(axis=1) > SPLIT_SIZE * size
    split, cloned = np.sort(wanted[large]), np.sort(wanted[~large])
    keep[split] = False
    kept = np.flatnonzero(keep)
    rows = np.concatenate([kept, cloned, split, split])
    adam.select(rows, np.arange(len(rows)) >= len(kept))
    _scatter(adam.values, np.arange(len(kept) + len(cloned), len(rows)), rng)


def _scatter(values: dict[str, Float32], rows: Int64, rng: np.random.Generator) -> None:
    """Put each of the rows at a random place of the Gaussian it was, and make it smaller."""
    offsets = np.exp(values["scales"][rows]) * rng.standard_normal((len(rows), 3))
    turned = rotations.rotate(rotations.normalised(values["rotations"][rows]), offsets)
    values["positions"][rows] += turned.astype(np.float32)
    values["scales"][rows] -= np.float32(np.log(SHRINK))


def reset_opacities(adam: Adam) -> None:
    """Take all opacities down, so that only what the images ask for comes back."""
    highest = np.float32(np.log(RESET / (1.0 - RESET)))
    np.minimum(adam.values["opacities"], highest, out=adam.values["opacities"])
    adam.forget("opacities")
