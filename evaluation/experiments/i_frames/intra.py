"""I-frames alone against SPZ, SOG and what they were before grading.

    python -m evaluation.experiments.i_frames.intra

Single trained splats, each as a sequence of one frame; every method in fresh processes, files on disk, images
from the scene's cameras. Scenes whose name ends in `part` have at most 40 000 Gaussians, every n-th of a
whole one, so that SOG can be asked; it takes minutes for each. Figures are cached as those of the comparison.

`vs`: our bytes divided by the other's at its PSNR. `lossless`: that quality against general compressors.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import zstandard

from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply, write_ply
from evaluation.baselines.method import SequenceFacts, frame_path
from evaluation.bd import bd_delta, rate_at
from evaluation.fresh import run_fresh
from evaluation.measure import Rated, Subject, measure
from evaluation.points import Point, baseline_points, codec_point
from evaluation.sequences import WORK, Sequence
from lab.assets import find_asset, present
from lab.record import write_result
from lab.views import FEW

QPS = (2, 6, 10, 14, 18, 22, 26, 30, 34, 40)
#: our curves: EncoderTuning
CURVES: dict[str, dict[str, bool]] = {
    "graded": {},
    "no balance": {"balance": False},
    "uniform": {"visibility": False},
}
_BASELINES = ("spz", "sog")
_PART = 40_000
_ZSTD_LEVEL, _XZ_PRESET = 22, 9
_BAR_PSNR = 40.0


@dataclass(frozen=True)
class Splat:
    """`views`: whose cameras rate it; `is_part`: every n-th Gaussian, at most 40 000."""

    name: str
    asset: str
    views: str
    is_part: bool = False

    def cloud(self) -> GaussianCloud:
        """Its one frame."""
        whole, _ = read_ply(find_asset(self.asset))
        if not self.is_part:
            return whole
        return whole.take(np.arange(0, whole.num_gaussians, -(-whole.num_gaussians // _PART)))


SPLATS = (
    Splat("plant_114k_sh0", "plant_114k_sh0.ply", "plant_sway"),
    Splat("plant_sh0_part", "plant_114k_sh0.ply", "plant_sway", is_part=True),
    Splat("playbot_31k_sh2", "playbot_31k_sh2.ply", "playbot_sway_drift"),
    Splat("playbot_125k_sh2", "playbot_125k_sh2.ply", "playbot_part_noisy"),
    Splat("sushi_77k_sh3", "sushi_77k_sh3.ply", "sushi_part"),
    Splat("sushi_sh3_part", "sushi_77k_sh3.ply", "sushi_part", is_part=True),
)


def _sequence(splat: Splat) -> Sequence:
    folder = WORK / "frames" / f"intra_{splat.name}"
    cloud = splat.cloud()
    if not frame_path(folder, 0).exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_ply(frame_path(folder, 0), cloud)
    digest = hashlib.sha256(frame_path(folder, 0).read_bytes()).hexdigest()
    return Sequence(splat.views, folder, SequenceFacts(1, (cloud.num_gaussians,), cloud.sh_degree), digest)


def _codec_point(curve: str, qp: int) -> Point:
    return codec_point("dfcgs_intra", f"intra {curve} qp{qp}", {"qp": qp, "tuning": CURVES[curve]})


def _kept(figures: dict[str, Any]) -> dict[str, Any]:
    names = ("bytes", "bits_per_gaussian", "psnr", "ssim", "encode_s_per_frame", "decode_s_per_frame")
    return {name: figures[name] for name in (*names, "bytes_by_attribute") if name in figures}


def lossless(sequence: Sequence) -> dict[str, int]:
    """Bytes of the PLY, of `--quality lossless`, and of general compressors at their best."""
    path = frame_path(sequence.folder, 0)
    data, target = path.read_bytes(), WORK / "lossless.dgs"
    module = [sys.executable, "-m", "dfcgs_codec"]
    options = ["--quality", "lossless", "--force", "--quiet"]
    command = [*module, "encode", str(sequence.folder), str(target), *options]
    done = run_fresh(command)
    if done.exit_code:
        raise RuntimeError(f"{' '.join(command)}: {done.message}")
    ours = target.stat().st_size
    target.unlink()
    return {
        "ply": len(data),
        "dfcgs": ours,
        "zstd": len(zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(data)),
        "xz": len(lzma.compress(data, preset=_XZ_PRESET)),
    }


def against(ours: list[dict[str, Any]], other: dict[str, Any]) -> float | None:
    """Our bytes divided by the other's at its PSNR; None where our curve does not get there."""
    rate = rate_at([(p["bytes"], p["psnr"]) for p in ours], other["psnr"])
    return None if rate is None else rate / other["bytes"]


def compare(splat: Splat) -> dict[str, Any]:
    """All methods on one splat."""
    sequence = _sequence(splat)
    subject = Subject(sequence, Rated((0,), FEW))
    found: dict[str, Any] = {
        "num_gaussians": sequence.facts.num_gaussians[0],
        "sh_degree": sequence.facts.sh_degree,
    }
    curves = {}
    for curve in CURVES:
        points = [measure(subject, _codec_point(curve, qp)) for qp in QPS]
        failed = [p for p in points if "psnr" not in p]
        if failed:
            raise RuntimeError(f"{splat.name}: {failed[0]}")
        curves[curve] = [{"qp": qp, **_kept(p)} for qp, p in zip(QPS, points, strict=True)]
    found["curves"], found["others"] = curves, {}
    pairs = {name: [(p["bytes"], p["psnr"]) for p in points] for name, points in curves.items()}
    found["bits_at_40_db"] = {}
    for name, points in pairs.items():
        rate = rate_at(points, _BAR_PSNR)
        found["bits_at_40_db"][name] = rate and 8.0 * rate / found["num_gaussians"]
        delta = bd_delta(pairs["uniform"], points)
        found.setdefault("bd_rate_to_uniform", {})[name] = delta and delta.bd_rate
    for point in baseline_points():
        if point.method in _BASELINES:
            figures = measure(subject, point)
            if "psnr" not in figures:
                found["others"][point.method] = figures
                continue
            ratios = {name: against(points, figures) for name, points in curves.items()}
            found["others"][point.method] = {**_kept(figures), "vs": ratios}
    found["lossless"] = lossless(sequence)
    return found


def main() -> None:
    """Compare on all splats that are there and write the result."""
    results = {}
    for splat in present(SPLATS):
        results[splat.name] = compare(splat)
        short = {k: v for k, v in results[splat.name].items() if k != "curves"}
        print(splat.name, json.dumps(short), flush=True)
        conditions = {"views": list(FEW), "qps": list(QPS), "zstd": _ZSTD_LEVEL, "xz": _XZ_PRESET}
        print(write_result("intra", conditions, results))


if __name__ == "__main__":
    main()
