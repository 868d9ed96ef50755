"""How good the fit is and how its Gaussians move, per frame: `evaluation/results/fitted.json`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from lab.record import known_results, write_result
from lab.render import View
from lab.scenes import rotations
from training.fitting.capture import (
    IMAGE_SIZE,
    NUM_HELD_OUT,
    NUM_TRAINING,
    character_mask,
    held_out_cameras,
    psnr,
    take_views,
)
from training.fitting.sequences import FITTED, TrueFrame

RESULT = "fitted"

Row = dict[str, Any]


def quality(cloud: GaussianCloud, truth: TrueFrame, training: list[View]) -> Row:
    """PSNR in dB against training and held-out views, of whole images and of the character's pixels."""
    cameras = held_out_cameras()
    held_out = take_views(truth, cameras)
    masks = [character_mask(truth, camera) for camera in cameras]
    found = {
        "psnr_training": psnr(cloud, training),
        "psnr_held_out": psnr(cloud, held_out),
        "psnr_held_out_character": psnr(cloud, held_out, masks),
    }
    return {name: round(value, 2) for name, value in found.items()}


def motion(before: GaussianCloud, after: GaussianCloud) -> Row:
    """Shares of identical positions and rotations; medians of those that change, scene units and radians."""
    still = (before.positions == after.positions).all(axis=1)
    unturned = (before.rotations == after.rotations).all(axis=1)
    steps = np.linalg.norm(after.positions - before.positions, axis=1)[~still]
    turns = rotations.angles(before.rotations[~unturned], after.rotations[~unturned])
    return {
        "unmoved_share": round(float(still.mean()), 4),
        "unturned_share": round(float(unturned.mean()), 4),
        "displacement_median": _median(steps),
        "turn_median": _median(turns),
    }


def true_motion(before: TrueFrame, after: TrueFrame) -> Row:
    """The median displacement of the true character, scene units."""
    steps = (after.cloud.positions - before.cloud.positions)[after.is_character]
    return {"true_displacement_median": _median(np.linalg.norm(steps, axis=1))}


def _median(values: np.ndarray) -> float:
    return round(float(np.median(values)), 5) if len(values) else 0.0


def write_report(name: str, path: Path, rows: list[Row]) -> Path:
    """Put the rows of one sequence into the result file, beside those of the others."""
    conditions = {
        "image_size": IMAGE_SIZE,
        "views": {"training": NUM_TRAINING, "held_out": NUM_HELD_OUT},
        "sequences": {key: asdict(sequence) for key, sequence in FITTED.items()},
        "seconds": "of the fit alone, machine shared with other work",
    }
    entry = {"bytes": path.stat().st_size, "frames": rows}
    return write_result(RESULT, conditions, {**known_results(RESULT), name: entry})
