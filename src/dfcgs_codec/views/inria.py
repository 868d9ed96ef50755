"""`cameras.json` as INRIA's trainer writes it beside its point clouds: one object for each camera."""

from __future__ import annotations

from collections.abc import Sequence

from dfcgs_codec.arguments import real
from dfcgs_codec.views.camera import ViewCamera
from dfcgs_codec.views.fields import (
    check_count,
    matrix_of,
    record_of,
    told_of,
    vector_of,
    world_to_camera,
)

_KEYS = ("width", "height", "position", "rotation", "fx", "fy")


def _camera(value: object) -> ViewCamera:
    """One camera; its columns are right, down and forward in the world. The principal point is the middle."""
    found = record_of(value, _KEYS)
    rotation = matrix_of("rotation", found["rotation"], (3,), 3)
    pose = world_to_camera(rotation, vector_of("position", found["position"], 3))
    width, height = found["width"], found["height"]
    cx = found.get("cx", real("width", width) / 2)
    cy = found.get("cy", real("height", height) / 2)
    return ViewCamera(width, height, found["fx"], found["fy"], cx, cy, pose)


def cameras_of_inria(values: Sequence[object]) -> tuple[ViewCamera, ...]:
    """Cameras of the list that the file holds; InputError for anything that is no camera."""
    check_count(len(values))
    cameras = []
    for index, value in enumerate(values):
        with told_of(f"camera {index}"):
            cameras.append(_camera(value))
    return tuple(cameras)
