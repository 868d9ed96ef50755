"""One prepared GoF: a decoded I-frame, the frames that follow it, and who spreads motion over whom."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float16, Float64, Int32, Int64, Integers
from lab.render.camera import Camera

#: frames of a GoF, the I-frame among them
NUM_FRAMES = 5


@dataclass(frozen=True, eq=False)
class Gof:
    """N Gaussians in canonical order, n control points, K neighbours of each.

    `positions` (5, N, 3), `rotations` (5, N, 4): frame 0 as decoded, the others as they should be, all on the
    grids of the state; `scales` (N, 3), `opacities` (N, 1), `colours` (N, 3 + ...): of the decoded I-frame.
    `units` (4,): exponents of position, scale, opacity, colour. `centre` (3,), `extent_log2` (): the
    normalisation. `control` (n,), `neighbours`, `weights` (n, K): rows, and shares in 2**-16.
    `images` (views, 4, H, W, 3): what `cameras` (views, 20: 4 x 4 matrix, fx fy cx cy) see of P-frames.
    """

    positions: Int32
    rotations: Int32
    scales: Int32
    opacities: Int32
    colours: Int32
    units: Int64
    centre: Int64
    extent_log2: Int64
    control: Int64
    neighbours: Int64
    weights: Int64
    images: Float16
    cameras: Float64

    @property
    def num_gaussians(self) -> int:
        return self.positions.shape[1]

    @property
    def log2_unit(self) -> int:
        """k: one of the normalised scene is 2**k scene units."""
        return int(self.extent_log2) + int(self.units[0])

    def camera(self, view: int) -> Camera:
        """Of the images of that view."""
        row = self.cameras[view]
        height, width = self.images.shape[2:4]
        return Camera(row[:16].reshape(4, 4), *(float(value) for value in row[16:]), width, height)

    def save(self, path: Path) -> None:
        """Under its name only when whole."""
        partial = path.with_name(path.name + ".tmp")
        with partial.open("wb") as file:
            np.savez(file, **{field.name: getattr(self, field.name) for field in fields(self)})
        os.replace(partial, path)

    @staticmethod
    def load(path: Path) -> Gof:
        """What `save` wrote."""
        with np.load(path) as arrays:
            return Gof(**{field.name: arrays[field.name] for field in fields(Gof)})


def camera_row(camera: Camera) -> Float64:
    """A camera as `Gof.cameras` has it."""
    return np.append(camera.world_to_camera.reshape(-1), [camera.fx, camera.fy, camera.cx, camera.cy])


def normalisation(positions: Integers) -> tuple[Int64, int]:
    """Centre (3,) and e of grid `positions` (N, 3): the bulk of (p - centre) / 2**e lies in [-1, 1]."""
    ranked = np.sort(positions.astype(np.int64), axis=0)
    count = len(ranked)
    centre = ranked[count >> 1]
    low, high = ranked[count * 5 // 100], ranked[min(count - 1, count * 95 // 100)]
    extent = max(1, int(np.maximum(high - centre, centre - low).max()))
    return centre, (extent - 1).bit_length()
