"""Bytes at equal PSNR of two states of the codec on six scenes: objects, what noise and births do, captures.

    python -m evaluation.experiments.six_scenes FIRST.json       # in a checkout of the one
    python -m evaluation.experiments.six_scenes SECOND.json --against FIRST.json

Frames are encoded at two QPs. Bytes of the second are moved along the curve of the first to its PSNR, so that
the percentages are of whole files. With `--against` both land in `evaluation/results/six_scenes.json`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence as Arguments
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence
from evaluation.promise import subject_of
from lab.quality import frame_quality, summary
from lab.record import write_result
from lab.scenes.catalogue import is_capture, scene
from lab.views import cameras

_SCENES = (
    "mage_fitted",
    "playbot_sway_drift",
    "lumberjack_walk_noisy",
    "playbot_twist_semi",
    "kitchen_capture",
    "dungeon_capture",
)
_NUM_FRAMES, _QPS = 6, (20, 32)

Figures = dict[str, Any]


def _point(name: str, qp: int) -> Figures:
    """Bytes, PSNR, and seconds of the processor."""
    subject = subject_of(scene(name), _NUM_FRAMES)
    sequence, rated = subject.sequence, subject.rated
    frames = [sequence.frame(index) for index in range(sequence.facts.num_frames)]
    views, whole = cameras(sequence.name, rated.views), is_capture(sequence.name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence.dgs"
        start = time.process_time()
        report = encode_sequence(frames, path, EncoderOptions(qp=qp, jobs=1))
        middle = time.process_time()
        clouds = [frame.cloud() for frame in decode_sequence(path)]
        end = time.process_time()
    found = [frame_quality(i, subject.source_images[i], clouds[i], views, whole) for i in rated.frames]
    seconds = {"encode_cpu_s": round(middle - start, 2), "decode_cpu_s": round(end - middle, 2)}
    return {"qp": qp, "bytes": report.num_bytes, "psnr": summary(found)["psnr"], **seconds}


def change(before: list[Figures], now: list[Figures]) -> float:
    """Percent of bytes at the PSNR of `before`, mean of two points of each curve."""
    first, last = before[0], before[-1]
    slope = np.log(first["bytes"] / last["bytes"]) / (first["psnr"] - last["psnr"])
    pairs = zip(before, now, strict=True)
    logs = [np.log(b["bytes"] / a["bytes"]) - slope * (b["psnr"] - a["psnr"]) for a, b in pairs]
    return float(100.0 * np.expm1(np.mean(logs)))


def main(arguments: Arguments[str] | None = None) -> None:
    """Measure this checkout, and compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, help="where the points go")
    parser.add_argument("--against", type=Path, help="points of another state")
    args = parser.parse_args(arguments)
    found = {name: [_point(name, qp) for qp in _QPS] for name in _SCENES}
    args.out.write_text(json.dumps(found, indent=1) + "\n")
    if args.against is None:
        return
    before = json.loads(args.against.read_text())
    changes = {name: round(change(before[name], found[name]), 2) for name in found}
    changes["mean"] = round(float(np.mean(list(changes.values()))), 2)
    print(changes)
    results = {"change_percent": changes, "before": before, "now": found}
    write_result("six_scenes", {"frames": _NUM_FRAMES, "qps": list(_QPS)}, results)


if __name__ == "__main__":
    main()
