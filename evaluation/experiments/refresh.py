"""An I-frame now and then, a P-frame that mends everything, or neither.

    python -m evaluation.experiments.refresh

The first frames of the long scenes at one QP. `I`: GoFs of so many frames. `refresh`: one GoF, in which every
so many frames a P-frame leaves no error as it is: no zero bin, and what a coarser step of the I-frame left is
mended, too. It is an experiment, not an option of the encoder. `none`: one GoF and nothing of the kind.
PSNR of every third frame from two views; `seek`: frames to decode for one at random, in the mean.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.encoder import inter_coding
from dfcgs_codec.encoder.analysis import ResidualQuantiser, ZeroBin
from evaluation.bd import rate_at
from lab.assets import find_asset, present
from lab.quality import frame_quality, image, psnr
from lab.record import write_result
from lab.scenes.catalogue import group
from lab.views import cameras

PERIODS = (10, 30, 60)
QPS = (24, 28, 32)
NUM_FRAMES = 61
VIEWS = (0, 3)
_EVERY = 3


@contextmanager
def refreshing(period: int | None) -> Iterator[None]:
    """P-frames whose index is a multiple of `period` mend everything, meanwhile."""
    original = inter_coding.InterCoder._coded
    is_due = False

    def coded(coder: Any, task: Any, trial: Any) -> Any:
        nonlocal is_due
        is_due = period is not None and task.index % period == 0
        return original(coder, task, trial)

    def quantiser(*values: Any) -> ResidualQuantiser:
        found = ResidualQuantiser(*values)
        return replace(found, zero_bin=ZeroBin(0.5), slack={}) if is_due else found

    with (
        mock.patch.object(inter_coding.InterCoder, "_coded", coded),
        mock.patch.object(inter_coding, "ResidualQuantiser", quantiser),
    ):
        yield


def variants() -> dict[str, tuple[int, int | None]]:
    """GoF size and period of refreshes by name."""
    found: dict[str, tuple[int, int | None]] = {"none": (NUM_FRAMES, None)}
    for period in PERIODS:
        found[f"I {period}"] = (period, None)
        found[f"refresh {period}"] = (NUM_FRAMES, period)
    return found


def run(frames: list[GaussianCloud], how: tuple[int, int | None], qp: float, views: Any) -> dict[str, Any]:
    """Bytes of the file, PSNR of its frames."""
    gof_size, period = how
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence.dgs"
        with refreshing(period):
            encode_sequence(frames, path, EncoderOptions(qp=qp, gof_size=gof_size))
        errors = []
        for index, decoded in enumerate(decode_sequence(path)):
            if index % _EVERY == 0:
                source = [image(frames[index], view) for view in views]
                errors.append(frame_quality(index, source, decoded.cloud(), views).visible.mse)
        size = path.stat().st_size
    mean, worst = psnr(float(np.mean(errors))), psnr(max(errors))
    assert mean is not None
    assert worst is not None
    return {"qp": qp, "bytes": size, "psnr": round(mean, 3), "psnr_worst_frame": round(worst, 3)}


def summary(curves: dict[str, list[dict[str, Any]]], num_frames: int) -> dict[str, Any]:
    """Bytes at the PSNR that `none` has at the middle QP, relative to it; mean frames decoded to seek."""
    middle = curves["none"][len(curves["none"]) // 2]
    found = {}
    for name, (gof_size, _) in variants().items():
        bytes_then = rate_at([(p["bytes"], p["psnr"]) for p in curves[name]], middle["psnr"])
        ratio = None if bytes_then is None else round(bytes_then / middle["bytes"], 4)
        lengths = [min(gof_size, num_frames - start) for start in range(0, num_frames, gof_size)]
        seek = sum(length * (length + 1) / 2 for length in lengths) / num_frames
        found[name] = {"ratio_to_none": ratio, "seek": round(seek, 1)}
    return found


def main() -> None:
    """Measure the long scenes that are there and write the result."""
    results = {}
    for scene in present(group("long")):
        frames = list(itertools.islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
        views = cameras(scene.name, VIEWS)
        curves: dict[str, list[dict[str, Any]]] = {}
        for name, how in variants().items():
            curves[name] = [run(frames, how, qp, views) for qp in QPS]
            print(scene.name, name, curves[name], flush=True)
        results[scene.name] = {"curves": curves, "summary": summary(curves, len(frames))}
        print(scene.name, results[scene.name]["summary"], flush=True)
        conditions = {"qps": QPS, "views": VIEWS, "frames": NUM_FRAMES, "every": _EVERY}
        print(write_result("refresh", conditions, results))


if __name__ == "__main__":
    main()
