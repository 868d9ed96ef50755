"""What lies beside a capture's frames: the cameras of its fit and true images from the evaluation's views."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float32
from lab.assets import find_asset
from lab.captures import keep
from lab.render import Camera
from lab.scenes.catalogue import scene as named_scene


def folder(scene: str) -> Path:
    """The folder of a capture; raises FileNotFoundError where it is not on this machine."""
    return find_asset(named_scene(scene).asset).with_suffix("")


def cameras_file(scene: str) -> Path:
    """The cameras that a capture was fitted to, as INRIA's trainer writes them."""
    return folder(scene) / keep.CAMERAS


def true_images(scene: str, views: dict[int, Camera], frames: tuple[int, ...]) -> dict[int, list[Float32]]:
    """True images (H, W, 3) in [0, 1] by frame, one for each view; none of frames that were not kept."""
    kept = {view: keep.read_images(folder(scene), view, camera.height) for view, camera in views.items()}
    return {
        frame: [(kept[view][frame // keep.EVERY] / 255.0).astype(np.float32) for view in views]
        for frame in frames
        if frame % keep.EVERY == 0
    }
