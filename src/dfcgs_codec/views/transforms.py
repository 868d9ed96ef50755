"""`transforms.json` of nerfstudio, instant-ngp and the synthetic scenes of NeRF.

Poses are those of OpenGL: x right, y up, z backward, camera to world. Values that a frame has itself come
before those of all frames. Splats that nerfstudio exports are in the frame that its data parser has made:
where its `dataparser_transforms.json` lies beside, poses are taken there, else they stay as they are.
"""

from __future__ import annotations

import math
from collections import ChainMap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import LARGEST, ViewCamera
from dfcgs_codec.views.fields import (
    Record,
    check_count,
    finite,
    json_of,
    matrix_of,
    record_of,
    told_of,
    world_to_camera,
)

PARSER_FILE = "dataparser_transforms.json"
#: pixels of a side where no key tells: the synthetic scenes of NeRF, whose images alone do
DEFAULT_SIDE = 800
#: OpenGL's axes by those of COLMAP
_FLIP = np.array([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class _Frame:
    """How poses of the file come into the frame of the splats: rigidly by `matrix` (4, 4), then scaled."""

    matrix: Float64
    scale: float


def _square(name: str, value: object) -> Float64:
    matrix = matrix_of(name, value, (3, 4), 4)
    return np.vstack([matrix[:3], [0, 0, 0, 1]])


def _above_0(name: str, value: object) -> float:
    number = finite(name, value)
    if not number > 1 / LARGEST:
        raise InputError(f"{name}: found {number:g}, expected a number above 0")
    return number


def _to_splats(path: Path, content: Record) -> _Frame:
    """From poses of the file to splats; the parser's transform begins before those that are applied."""
    parser = path.parent / PARSER_FILE
    if not parser.is_file():
        return _Frame(np.eye(4), 1.0)
    applied = _square("applied_transform", content.get("applied_transform", np.eye(4).tolist()))
    applied_scale = _above_0("applied_scale", content.get("applied_scale", 1.0))
    if abs(np.linalg.det(applied)) < 1e-9:
        raise InputError("applied_transform: found a matrix that cannot be undone, expected a rigid one")
    with told_of(parser.name):
        found = record_of(json_of(parser), ("transform", "scale"))
        transform = _square("transform", found["transform"])
        scale = _above_0("scale", found["scale"])
    return _Frame(transform @ np.linalg.inv(applied), scale / applied_scale)


def _side(found: Record, side: str, centre: str) -> float | None:
    """Pixels of a side: as it is said, or twice the principal point; None where neither is."""
    if side in found:
        return finite(side, found[side])
    return 2 * finite(centre, found[centre]) if centre in found else None


def _focal(found: Record, focal: str, angle: str, side: float | None) -> float | None:
    """A focal length in pixels, of itself or by the angle of view; None where neither is."""
    if focal in found and side is not None:
        return finite(focal, found[focal])
    if angle not in found:
        return None
    view = finite(angle, found[angle])
    if not 0 < view < math.pi:
        raise InputError(f"{angle}: found {view:g}, expected an angle in radians between 0 and pi")
    return (DEFAULT_SIDE if side is None else side) / 2 / math.tan(view / 2)


def _intrinsics(found: Record) -> tuple[int, int, float, float, float, float]:
    width, height = _side(found, "w", "cx"), _side(found, "h", "cy")
    height = height if height is not None else width
    fx = _focal(found, "fl_x", "camera_angle_x", width)
    if fx is None:
        raise InputError("found neither fl_x with w or cx, nor camera_angle_x, expected one of them")
    fy = _focal(found, "fl_y", "camera_angle_y", height)
    fy = fx if fy is None else fy
    w, h = DEFAULT_SIDE if width is None else width, DEFAULT_SIDE if height is None else height
    centre = [finite(name, found.get(name, side / 2)) for name, side in (("cx", w), ("cy", h))]
    return round(w), round(h), fx, fy, centre[0], centre[1]


def _camera(found: Record, frame: _Frame) -> ViewCamera:
    pose = frame.matrix @ _square("transform_matrix", found["transform_matrix"])
    return ViewCamera(*_intrinsics(found), world_to_camera(pose[:3, :3] * _FLIP, pose[:3, 3] * frame.scale))


def cameras_of_transforms(path: Path, value: object) -> tuple[ViewCamera, ...]:
    """Cameras of the object that the file at `path` holds; InputError for anything that is no camera."""
    content = record_of(value, ("frames",))
    frames = content["frames"]
    if not isinstance(frames, list):
        raise InputError(f"frames: found a {type(frames).__name__}, expected a list")
    check_count(len(frames), "frames")
    frame = _to_splats(path, content)
    cameras = []
    for index, own in enumerate(frames):
        with told_of(f"frame {index}"):
            found = ChainMap(dict(record_of(own, ("transform_matrix",))), dict(content))
            cameras.append(_camera(found, frame))
    return tuple(cameras)
