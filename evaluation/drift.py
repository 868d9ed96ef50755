"""Drift: does quality sink with the distance from the I-frame? `python -m evaluation.drift`.

The long scenes are coded at one QP with every GoF size and with I-frames only. Each frame is rendered from
two views; drift is the difference of its PSNR from that of all-intra coding, frame by frame, and `slope` the
least-squares slope of that difference, decibel per 100 frames.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.ply import read_ply
from evaluation.assets import has_asset
from evaluation.baselines.method import frame_path
from evaluation.fresh import run_fresh
from evaluation.points import codec_version
from evaluation.quality import frame_quality, image, psnr
from evaluation.record import write_result
from evaluation.sequences import WORK, Sequence, materialise
from evaluation.views import cameras
from training.scenes.catalogue import group

GOF_SIZES = (4, 10, 32, 60, 300)
QP = 28
VIEWS = (0, 3)
_CACHE = WORK / "cache"


def _decode(sequence: Sequence, gof_size: int, work: Path) -> tuple[Path, int]:
    """The decoded frames' folder, and the size of the file."""
    file, folder = work / f"gof{gof_size}.dgs", work / f"gof{gof_size}"
    module = [sys.executable, "-m", "dfcgs_codec"]
    options = ["--qp", str(QP), "--gof-size", str(gof_size), "--quiet"]
    for command in (
        [*module, "encode", str(sequence.folder), str(file), *options],
        [*module, "decode", str(file), str(folder), "--quiet"],
    ):
        run = run_fresh(command)
        if run.exit_code:
            raise RuntimeError(run.message)
    return folder, file.stat().st_size


def _psnrs(sequence: Sequence, folders: dict[int, Path]) -> dict[int, list[float]]:
    """PSNR of every frame by GoF size; each source frame is rendered once."""
    views = cameras(sequence.name, VIEWS)
    result: dict[int, list[float]] = {size: [] for size in folders}
    for index in range(sequence.facts.num_frames):
        source = sequence.frame(index)
        images = [image(source, view) for view in views]
        for size, folder in folders.items():
            cloud, _ = read_ply(frame_path(folder, index))
            value = psnr(frame_quality(index, images, cloud, views).visible.mse)
            result[size].append(float("nan") if value is None else round(value, 4))
    return result


def _slope(difference: np.ndarray) -> float:
    """Decibel per 100 frames."""
    return 100.0 * float(np.polyfit(np.arange(len(difference)), difference, 1)[0])


def measure(sequence: Sequence) -> dict[str, Any]:
    """PSNR by frame and drift for every GoF size."""
    WORK.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=WORK) as name:
        coded = {size: _decode(sequence, size, Path(name)) for size in (1, *GOF_SIZES)}
        values = _psnrs(sequence, {size: folder for size, (folder, _) in coded.items()})
    intra = np.array(values[1])
    result: dict[str, Any] = {"intra": {"bytes": coded[1][1], "psnr": values[1]}}
    for size in GOF_SIZES:
        difference = np.array(values[size]) - intra
        result[f"gof{size}"] = {
            "bytes": coded[size][1],
            "psnr": values[size],
            "mean_difference": float(difference.mean()),
            "worst_difference": float(difference.min()),
            "slope_per_100_frames": _slope(difference),
        }
    return result


def _cached(sequence: Sequence) -> dict[str, Any]:
    path = _CACHE / f"drift_{sequence.digest[:16]}_{codec_version()}.json"
    if not path.exists():
        _CACHE.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(measure(sequence)))
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def main() -> None:
    """Measure the long scenes that are there and write the result."""
    results = {}
    for scene in group("long"):
        if not has_asset(scene.asset):
            print(f"{scene.name}: skipped, {scene.asset} is not on this machine", file=sys.stderr)
            continue
        results[scene.name] = measured = _cached(materialise(scene))
        for size in GOF_SIZES:
            figures = measured[f"gof{size}"]
            short = {k: round(v, 3) for k, v in figures.items() if isinstance(v, float)}
            print(scene.name, size, figures["bytes"], short, flush=True)
    print(write_result("drift", {"qp": QP, "views": VIEWS, "gof_sizes": GOF_SIZES}, results))


if __name__ == "__main__":
    main()
