"""Where the cameras stand: those of the fit, and those between them that judge it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from lab.captures.rooms import Triple
from lab.render import Camera, look_at

#: width and height, pixels
SIZE = (320, 240)
#: the rectangle of a forward rig: columns and rows, width as a share of the distance to the target
COLUMNS, ROWS, WIDTH_SHARE = 5, 4, 0.25
#: the rings of an inside rig: cameras on each, height and radius in shares of the rig's, where they look
RING = 14
#: places between the cameras of a forward rig, in columns and rows
FORWARD_VIEWS = (
    (0.5, 0.5),
    (3.5, 0.5),
    (1.5, 1.5),
    (2.5, 1.5),
    (0.5, 2.5),
    (3.5, 2.5),
    (1.5, 0.5),
    (2.5, 2.5),
)


@dataclass(frozen=True)
class Rig:
    """Cameras that look at `target`: before it at `middle` (forward), or on rings around it (inside).

    forward: `middle` is the middle of the rectangle. inside: the rings stand around `target`, as far from it
    and as high as `middle` is; every other camera looks inwards, across the middle, the rest along the wall.
    """

    kind: Literal["forward", "inside"]
    middle: Triple
    target: Triple
    vertical_fov: float

    @property
    def distance(self) -> float:
        """From the middle to the target, scene units; the size of what is captured."""
        return math.dist(self.middle, self.target)


def fitting_cameras(rig: Rig, size: tuple[int, int] = SIZE) -> list[Camera]:
    """The cameras whose images are fitted: 20 of a forward rig, 28 of one inside."""
    if rig.kind == "forward":
        return [_on_rectangle(rig, column, row, size) for row in range(ROWS) for column in range(COLUMNS)]
    return [_on_ring(rig, index, level, size) for level in (0.0, 1.0) for index in range(RING)]


def evaluation_cameras(rig: Rig, size: tuple[int, int] = SIZE) -> list[Camera]:
    """Eight cameras between those of the fit."""
    if rig.kind == "forward":
        return [_on_rectangle(rig, column, row, size) for column, row in FORWARD_VIEWS]
    return [_on_ring(rig, RING * i / 8 + 0.5 * (i % 2), 0.5, size) for i in range(8)]


def _on_rectangle(rig: Rig, column: float, row: float, size: tuple[int, int]) -> Camera:
    middle, target = np.array(rig.middle), np.array(rig.target)
    forward = (target - middle) / rig.distance
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    width = WIDTH_SHARE * rig.distance
    spacing = width / (COLUMNS - 1)
    offset = spacing * ((column - (COLUMNS - 1) / 2) * right - (row - (ROWS - 1) / 2) * up)
    return look_at((middle + offset).tolist(), rig.target, size, rig.vertical_fov)


def _on_ring(rig: Rig, index: float, level: float, size: tuple[int, int]) -> Camera:
    """Camera `index` of RING, on the lower ring (level 0), the upper one (1) or between."""
    middle, target = np.array(rig.middle), np.array(rig.target)
    radius = math.hypot(*(middle - target)[[0, 2]]) * (1.0 - 0.15 * level)
    height = middle[1] + 0.35 * rig.distance * level
    angle = 2.0 * math.pi * (index + 0.5 * level) / RING
    eye = np.array([target[0] + radius * math.cos(angle), height, target[2] + radius * math.sin(angle)])
    # across the middle, but not all through one point: each looks a little to its left or right
    aside = 0.35 * radius * math.cos(math.pi * index)
    look = target + aside * np.array([-math.sin(angle), 0.0, math.cos(angle)])
    return look_at(eye.tolist(), look.tolist(), size, rig.vertical_fov)


def inria_cameras(cameras: list[Camera]) -> list[dict[str, Any]]:
    """The content of a `cameras.json` as INRIA's trainer writes it: camera-to-world poses, focal lengths."""
    return [
        {
            "id": index,
            "img_name": f"{index:05d}",
            "width": camera.width,
            "height": camera.height,
            "position": camera.position.tolist(),
            "rotation": camera.world_to_camera[:3, :3].T.tolist(),
            "fy": camera.fy,
            "fx": camera.fx,
        }
        for index, camera in enumerate(cameras)
    ]
