"""Files of cameras in every format, written from `ViewCamera`s without the readers' code."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dfcgs_codec.array_types import Float64
from dfcgs_codec.views.camera import ViewCamera

#: COLMAP's models with one focal length, by number and name, and how many parameters of distortion they have
ONE_FOCAL = {0: ("SIMPLE_PINHOLE", 0), 2: ("SIMPLE_RADIAL", 1), 3: ("RADIAL", 2), 9: ("RADIAL_FISHEYE", 2)}


def camera(
    position: Sequence[float] | Float64 = (0, 0, 0),
    turn: Sequence[float] = (0, 0, 0),
    *,
    size: tuple[int, int] = (640, 480),
    focal: tuple[float, float] = (500.0, 510.0),
) -> ViewCamera:
    """A camera at `position`, turned by the rotation vector `turn` (radians)."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix().T
    pose[:3, 3] = -pose[:3, :3] @ np.array(position, float)
    return ViewCamera(*size, *focal, size[0] / 2, size[1] / 2, pose)


def some_cameras(count: int = 3) -> list[ViewCamera]:
    """Of different places, turns and sizes."""
    rng = np.random.default_rng(4)
    return [
        camera(rng.normal(size=3) * 4, rng.normal(size=3), size=(640 + 2 * i, 480), focal=(500 + i, 510 + i))
        for i in range(count)
    ]


def close(found: Sequence[ViewCamera], wanted: Sequence[ViewCamera], tolerance: float = 1e-6) -> bool:
    """Whether the cameras are the same, but for rounding."""
    return len(found) == len(wanted) and all(
        (a.width, a.height) == (b.width, b.height)
        and np.allclose((a.fx, a.fy, a.cx, a.cy), (b.fx, b.fy, b.cx, b.cy), atol=tolerance)
        and np.allclose(a.world_to_camera, b.world_to_camera, atol=tolerance)
        for a, b in zip(found, wanted, strict=True)
    )


def camera_to_world(view: ViewCamera) -> Float64:
    return np.linalg.inv(view.world_to_camera)


def inria(views: Sequence[ViewCamera]) -> list[dict[str, Any]]:
    """What `cameras.json` holds."""
    return [
        {
            "id": index,
            "img_name": f"{index:05d}",
            "width": view.width,
            "height": view.height,
            "position": camera_to_world(view)[:3, 3].tolist(),
            "rotation": camera_to_world(view)[:3, :3].tolist(),
            "fy": view.fy,
            "fx": view.fx,
        }
        for index, view in enumerate(views)
    ]


def transforms(views: Sequence[ViewCamera]) -> dict[str, Any]:
    """What `transforms.json` holds, each frame with its own intrinsics."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [
        {
            "file_path": f"images/{index:05d}.png",
            "transform_matrix": (camera_to_world(view) @ flip).tolist(),
            "fl_x": view.fx,
            "fl_y": view.fy,
            "cx": view.cx,
            "cy": view.cy,
            "w": view.width,
            "h": view.height,
        }
        for index, view in enumerate(views)
    ]
    return {"camera_model": "OPENCV", "frames": frames}


def _quaternion(view: ViewCamera) -> list[float]:
    x, y, z, w = Rotation.from_matrix(view.rotation).as_quat()
    return [float(value) for value in (w, x, y, z)]


def colmap_text(folder: Path, views: Sequence[ViewCamera], points: str = "1.5 2.5 -1 3.5 4.5 7") -> Path:
    """`cameras.txt` and `images.txt`; every other image has no points."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = ["# Camera list"], ["# Image list", "#   POINTS2D[]"]
    for index, view in enumerate(views):
        key = 7 + index
        cameras.append(
            f"{key} PINHOLE {view.width} {view.height} {view.fx!r} {view.fy!r} {view.cx} {view.cy}"
        )
        numbers = [*_quaternion(view), *view.world_to_camera[:3, 3].tolist()]
        images.append(f"{index + 1} {' '.join(map(repr, numbers))} {key} {index:05d}.jpg")
        images.append(points if index % 2 else "")
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    return folder


def colmap_binary(
    folder: Path, views: Sequence[ViewCamera], *, model: int = 1, count: int | None = None
) -> Path:
    """`cameras.bin` and `images.bin`, which say that they hold `count` records."""
    folder.mkdir(parents=True, exist_ok=True)
    said = len(views) if count is None else count
    cameras, images = [struct.pack("<Q", said)], [struct.pack("<Q", said)]
    for index, view in enumerate(views):
        values = [view.fx, view.fy, view.cx, view.cy]
        if model in ONE_FOCAL:
            values = [view.fx, view.cx, view.cy, *[0.01] * ONE_FOCAL[model][1]]
        elif model != 1:
            values += [0.01] * 4
        cameras.append(struct.pack("<iiQQ", 7 + index, model, view.width, view.height))
        cameras.append(struct.pack(f"<{len(values)}d", *values))
        pose = [*_quaternion(view), *view.world_to_camera[:3, 3]]
        images.append(struct.pack("<i7di", index + 1, *pose, 7 + index) + f"{index:05d}.jpg".encode() + b"\0")
        images.append(struct.pack("<Q", index) + struct.pack("<ddq", 1.5, 2.5, -1) * index)
    (folder / "cameras.bin").write_bytes(b"".join(cameras))
    (folder / "images.bin").write_bytes(b"".join(images))
    return folder


def write_json(path: Path, content: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


#: format -> writes the cameras into a folder and says what is to be read
WRITERS: dict[str, Callable[[Path, Sequence[ViewCamera]], Path]] = {
    "cameras.json": lambda folder, views: write_json(folder / "cameras.json", inria(views)),
    "transforms.json": lambda folder, views: write_json(folder / "transforms.json", transforms(views)),
    "COLMAP, text": lambda folder, views: colmap_text(folder / "sparse" / "0", views),
    "COLMAP, binary": lambda folder, views: colmap_binary(folder / "sparse" / "0", views),
}
