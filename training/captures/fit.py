"""Fit a capture frame by frame into its file, from where the file (or frame 0's checkpoint) ends."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.captures import keep
from lab.captures.captures import Capture, true_views
from lab.captures.rigs import evaluation_cameras, fitting_cameras
from lab.render import View
from lab.scenes.fitted import fitted_sequence, read_about, stepped
from training.captures.optimise import Progress, optimise
from training.captures.start import random_cloud
from training.fitting import store
from training.fitting.capture import psnr
from training.fitting.report import Row, motion
from training.fitting.track import track


def source(capture: Capture) -> dict[str, Any]:
    """How a capture is made, as its file says it."""
    about: dict[str, Any] = json.loads(json.dumps(asdict(capture)))
    return about


def stored_frames(path: Path, capture: Capture) -> list[GaussianCloud]:
    """The frames that are there; raises InputError where they were made with other settings."""
    if not path.exists():
        return []
    if read_about(path)["source"] != source(capture):
        raise InputError(f"{path} was made with other settings; remove it or choose another folder")
    return list(fitted_sequence(path))


def first_frame(capture: Capture, views: list[View], path: Path, progress: Progress | None) -> GaussianCloud:
    """Fit frame 0 and store it."""
    checkpoint = path.with_suffix(".checkpoint.npz")
    start = random_cloud(capture, [view.camera for view in views])
    cloud = store.shortened(optimise(start, capture, views, checkpoint, progress))
    store.create(path, cloud, source(capture))
    checkpoint.unlink(missing_ok=True)
    return cloud


def later_frame(
    capture: Capture, frames: list[GaussianCloud], views: tuple[list[View], list[View]], path: Path
) -> GaussianCloud:
    """Fit the frame after `frames`, store it and return it as stored; views: of this frame and the last."""
    last_step = frames[-1].positions - frames[-2].positions if len(frames) > 1 else None
    moved = track(frames[-1], last_step, views, capture.later_steps, (capture.seed, len(frames)))
    rows, steps = store.step_between(frames[-1], moved)
    store.append_step(path, len(frames), rows, steps)
    return stepped(frames[-1], rows, steps)


def fit_capture(
    name: str, capture: Capture, num_frames: int, folder: Path, progress: Progress | None = None
) -> Iterator[Row]:
    """Fit what `folder`/`name`.zip lacks of `num_frames` frames; keep cameras and some true images beside it.

    Yields a row of the report per frame: seconds of the fit (of its last run), PSNR in dB against the
    images that were fitted and against those between them, and how the Gaussians move.
    """
    path, beside = folder / f"{name}.zip", folder / name
    fitting, judging = fitting_cameras(capture.rig), evaluation_cameras(capture.rig)
    keep.write_cameras(beside, fitting)
    earlier = keep.read_report(beside)
    rows: list[Row] = []
    frames = stored_frames(path, capture)
    fitted, before = len(frames), []
    kept: list[list[keep.UInt8]] = [[] for _ in judging]
    for index, taken in enumerate(true_views(capture, [*fitting, *judging], num_frames)):
        views, between = taken[: len(fitting)], taken[len(fitting) :]
        start = time.perf_counter()
        if index >= fitted:
            new = later_frame(capture, frames, (views, before), path) if frames else None
            frames.append(new or first_frame(capture, views, path, progress))
        seconds = round(time.perf_counter() - start, 1)
        if index < fitted:
            seconds = earlier[index]["seconds"] if index < len(earlier) else None
        rows.append(_row(index, seconds, frames, views, between))
        if len(rows) >= len(earlier):
            keep.write_report(beside, rows)
        yield rows[-1]
        if index % keep.EVERY == 0:
            for images, view in zip(kept, between, strict=True):
                images.append(keep.to_bytes(view.image))
        before = views
    # nothing is measured on what is trained on
    for view, images in enumerate(kept if capture.group == "captures" else []):
        keep.write_images(beside, view, images)


def _row(
    index: int, seconds: float | None, frames: list[GaussianCloud], views: list[View], between: list[View]
) -> Row:
    row: Row = {"frame": index, "seconds": seconds, "num_gaussians": frames[index].num_gaussians}
    row["psnr_training"] = round(psnr(frames[index], views), 2)
    row["psnr_held_out"] = round(psnr(frames[index], between), 2)
    return row | (motion(frames[index - 1], frames[index]) if index else {})
