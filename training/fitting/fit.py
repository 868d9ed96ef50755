"""Fit a sequence frame by frame into its file, from where the file ends."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.render import View
from lab.scenes.fitted import fitted_sequence, read_about, stepped
from training.fitting import report, store
from training.fitting.capture import take_views, training_cameras
from training.fitting.first import fit_first, rough_cloud
from training.fitting.sequences import FittedSequence, TrueFrame, true_frames
from training.fitting.track import track


def stored_frames(path: Path, sequence: FittedSequence) -> list[GaussianCloud]:
    """The frames that are there; raises InputError where they were made with other settings."""
    if not path.exists():
        return []
    if read_about(path)["source"] != asdict(sequence):
        raise InputError(f"{path} was made with other settings; remove it or choose another file")
    return list(fitted_sequence(path))


def next_frame(
    frames: list[GaussianCloud],
    views: tuple[list[View], list[View]],
    truth: TrueFrame,
    sequence: FittedSequence,
    path: Path,
) -> GaussianCloud:
    """Fit the frame after `frames`, store it and return it as stored; views: of this frame and the last."""
    if not frames:
        cloud = fit_first(rough_cloud(truth, sequence), views[0], sequence.first_steps, sequence.seed)
        store.create(path, cloud, asdict(sequence))
        return cloud
    last_step = frames[-1].positions - frames[-2].positions if len(frames) > 1 else None
    seed = (sequence.seed, len(frames))
    moved = track(frames[-1], last_step, views, sequence.later_steps, seed)
    rows, steps = store.step_between(frames[-1], moved)
    store.append_step(path, len(frames), rows, steps)
    return stepped(frames[-1], rows, steps)


def fit_sequence(
    sequence: FittedSequence, num_frames: int, path: Path, seconds: list[float | None]
) -> Iterator[report.Row]:
    """Fit what the file lacks of `num_frames` frames; one row of the report per frame.

    seconds: what earlier frames took, for those that the file has.
    """
    frames = stored_frames(path, sequence)
    fitted = len(frames)
    before: tuple[TrueFrame, list[View]] | None = None
    for index, truth in enumerate(true_frames(sequence, num_frames)):
        views = take_views(truth, training_cameras())
        row: report.Row = {"frame": index}
        if index >= fitted:
            start = time.perf_counter()
            frames.append(next_frame(frames, (views, before[1] if before else []), truth, sequence, path))
            row["seconds"] = round(time.perf_counter() - start, 1)
        else:
            row["seconds"] = seconds[index] if index < len(seconds) else None
        row |= report.quality(frames[index], truth, views)
        if before:
            row |= report.motion(frames[index - 1], frames[index]) | report.true_motion(before[0], truth)
        yield row
        before = truth, views
