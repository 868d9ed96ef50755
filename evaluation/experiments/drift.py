"""Drift: does quality sink with the distance from the I-frame?

    python -m evaluation.experiments.drift [--only NAME ...]

The long scenes are coded at one QP with every GoF size, and with I-frames only
(NAMEs: `intra`, `gof60` and so on; the others stay as they were). Each frame is rendered from
two views; drift is the difference of its PSNR from that of all-intra coding, frame by frame, and `slope` the
least-squares slope of that difference, decibel per 100 frames.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence as Arguments
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.ply import read_ply
from evaluation.baselines.method import frame_path
from evaluation.fresh import run_fresh
from evaluation.points import codec_version
from evaluation.sequences import WORK, Sequence, materialise
from lab.assets import present
from lab.quality import frame_quality, image, psnr
from lab.record import known_results, write_result
from lab.scenes.catalogue import group
from lab.views import cameras

GOF_SIZES = (4, 10, 32, 60, 300)
QP = 28
VIEWS = (0, 3)
_CACHE = WORK / "cache"
_INTRA = "intra"
#: options of `dfcgs encode` by name
VARIANTS: dict[str, list[str]] = {
    _INTRA: ["--gof-size", "1"],
    **{f"gof{size}": ["--gof-size", str(size)] for size in GOF_SIZES},
}


def _decode(sequence: Sequence, variant: str, work: Path) -> tuple[Path, int]:
    """The decoded frames' folder, and the size of the file."""
    file, folder = work / f"{variant}.dgs", work / variant
    module = [sys.executable, "-m", "dfcgs_codec"]
    options = ["--qp", str(QP), *VARIANTS[variant], "--quiet"]
    for command in (
        [*module, "encode", str(sequence.folder), str(file), *options],
        [*module, "decode", str(file), str(folder), "--quiet"],
    ):
        run = run_fresh(command)
        if run.exit_code:
            raise RuntimeError(run.message)
    return folder, file.stat().st_size


def _psnrs(sequence: Sequence, folders: dict[str, Path]) -> dict[str, list[float]]:
    """PSNR of every frame by variant; each source frame is rendered once."""
    views = cameras(sequence.name, VIEWS)
    result: dict[str, list[float]] = {variant: [] for variant in folders}
    for index in range(sequence.facts.num_frames):
        source = sequence.frame(index)
        images = [image(source, view) for view in views]
        for variant, folder in folders.items():
            cloud, _ = read_ply(frame_path(folder, index))
            value = psnr(frame_quality(index, images, cloud, views).visible.mse)
            result[variant].append(float("nan") if value is None else round(value, 4))
    return result


def _slope(difference: np.ndarray) -> float:
    """Decibel per 100 frames."""
    return 100.0 * float(np.polyfit(np.arange(len(difference)), difference, 1)[0])


def _measured(sequence: Sequence, variants: list[str]) -> dict[str, Any]:
    """Bytes and PSNR by frame; from the cache where the same code measured them."""
    path = _CACHE / f"drift_{sequence.digest[:16]}_{codec_version()}.json"
    found: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    missing = [variant for variant in variants if variant not in found]
    if missing:
        _CACHE.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=WORK) as name:
            coded = {variant: _decode(sequence, variant, Path(name)) for variant in missing}
            values = _psnrs(sequence, {variant: folder for variant, (folder, _) in coded.items()})
        found |= {variant: {"bytes": size, "psnr": values[variant]} for variant, (_, size) in coded.items()}
        path.write_text(json.dumps(found))
    return {variant: found[variant] for variant in variants}


def compare(figures: dict[str, Any]) -> dict[str, Any]:
    """The same with each variant's difference from all-intra coding, in the order of `VARIANTS`."""
    intra = np.array(figures[_INTRA]["psnr"])
    result: dict[str, Any] = {}
    for variant in (v for v in VARIANTS if v in figures):
        result[variant] = {key: figures[variant][key] for key in ("bytes", "psnr")}
        if variant != _INTRA:
            difference = np.array(figures[variant]["psnr"]) - intra
            result[variant] |= {
                "mean_difference": float(difference.mean()),
                "worst_difference": float(difference.min()),
                "slope_per_100_frames": _slope(difference),
            }
    return result


def main(arguments: Arguments[str] | None = None) -> None:
    """Measure the long scenes that are there and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--only", nargs="*", choices=list(VARIANTS), default=list(VARIANTS), help="only these"
    )
    args = parser.parse_args(arguments)
    results = known_results("drift") if len(args.only) < len(VARIANTS) else {}
    for scene in present(group("long")):
        measured = compare(results.get(scene.name, {}) | _measured(materialise(scene), args.only))
        results[scene.name] = measured
        for variant in args.only:
            short = {k: round(v, 3) for k, v in measured[variant].items() if isinstance(v, float)}
            print(scene.name, variant, measured[variant]["bytes"], short, flush=True)
    print(write_result("drift", {"qp": QP, "views": VIEWS, "gof_sizes": GOF_SIZES}, results))


if __name__ == "__main__":
    main()
