"""What lies beside a capture's frames: its cameras, the fit's report, true images between the cameras."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from dfcgs_codec.array_types import Float32, UInt8
from lab.captures.rigs import inria_cameras
from lab.render import Camera

CAMERAS, REPORT = "cameras.json", "fit.json"
#: the images of every frame whose index is a multiple of this are kept
EVERY = 5


def write_cameras(folder: Path, cameras: Sequence[Camera]) -> None:
    """`cameras.json` with the cameras of the fit, as INRIA's trainer writes it."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = [json.dumps(entry) for entry in inria_cameras(list(cameras))]
    (folder / CAMERAS).write_text("[\n" + ",\n".join(entries) + "\n]\n")


def read_cameras(folder: Path) -> list[dict[str, Any]]:
    """The entries of `cameras.json`."""
    entries: list[dict[str, Any]] = json.loads((folder / CAMERAS).read_text())
    return entries


def read_report(folder: Path) -> list[dict[str, Any]]:
    """The rows that are there, one per frame."""
    path = folder / REPORT
    rows: list[dict[str, Any]] = json.loads(path.read_text()) if path.exists() else []
    return rows


def write_report(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """How good the fit is and how its Gaussians move, a row per frame."""
    (folder / REPORT).write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")


def to_bytes(image: Float32) -> UInt8:
    """Display values 0 to 1 -> 0 to 255."""
    return np.round(np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint8)


def image_path(folder: Path, view: int) -> Path:
    """Where the true images of one view are kept."""
    return folder / f"view_{view}.webp"


def write_images(folder: Path, view: int, images: Sequence[UInt8]) -> None:
    """Keep one view's images (H, W, 3), one below the other: lossless, and what does not move costs once."""
    stacked = Image.fromarray(np.concatenate(images))
    stacked.save(image_path(folder, view), lossless=True, quality=100, method=6)


def read_images(folder: Path, view: int, height: int) -> list[UInt8]:
    """The images of one view, (height, W, 3), of frames 0, EVERY, 2 EVERY, ..."""
    with Image.open(image_path(folder, view)) as stacked:
        rows = np.asarray(stacked.convert("RGB"))
    return np.split(rows, len(rows) // height)
