"""What it is worth to find out that an input is quantised.

    python -m evaluation.experiments.i_frames.quantised_input

Splats as SPZ version 4 gives them back, whose positions, scales and spherical harmonics are multiples of its
steps. `off`: coded as any other (`exact=False`). `auto`: the default, which keeps those values as they are
where it finds that worth it. PSNR is that of images against the input, which SPZ has quantised; `ratio`:
bytes of `auto` divided by those of `off` at its PSNR, None where `off` does not get there.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.ply import write_ply
from evaluation.baselines import spz
from evaluation.bd import rate_at
from evaluation.experiments.i_frames.intra import SPLATS
from lab.assets import present
from lab.quality import frame_quality, image, psnr
from lab.record import write_result
from lab.views import FEW, cameras

QPS = (2, 6, 10, 14, 18, 22, 26, 30, 34, 38)
AUTO_QPS = (8, 18, 24, 28, 32)


def quantised(cloud: GaussianCloud) -> tuple[int, GaussianCloud]:
    """Bytes of the SPZ file, and what it holds."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "frame.ply", Path(folder) / "frame.spz"
        write_ply(source, cloud)
        spz.encode_ply(source, target)
        return target.stat().st_size, spz.decode(target)


def coded(cloud: GaussianCloud, options: EncoderOptions) -> tuple[int, list[str], GaussianCloud]:
    """Bytes of the file, what the encoder said, and what comes out."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.dgs"
        report = encode_sequence([cloud], path, options)
        return path.stat().st_size, report.notes, next(iter(decode_sequence(path))).cloud()


def compare(cloud: GaussianCloud, scene: str) -> dict[str, Any]:
    """Both ways on one splat."""
    views = cameras(scene, FEW)
    sources = [image(cloud, view) for view in views]

    def point(qp: float, *, exact: bool) -> dict[str, Any]:
        size, notes, decoded = coded(cloud, EncoderOptions(qp=qp, tuning=EncoderTuning(exact=exact)))
        quality = psnr(frame_quality(0, sources, decoded, views).visible.mse)
        kept = any("quantised" in note for note in notes)
        return {"qp": qp, "bytes": size, "psnr": quality, "is_kept": kept}

    off = [point(qp, exact=False) for qp in QPS]
    auto = [point(qp, exact=True) for qp in AUTO_QPS]
    for found in auto:
        rate = rate_at([(p["bytes"], p["psnr"]) for p in off], found["psnr"])
        found["ratio"] = None if rate is None else round(found["bytes"] / rate, 3)
    return {"off": off, "auto": auto}


def main() -> None:
    """Measure the splats that are there and write the result."""
    results = {}
    for splat in present(SPLATS):
        size, cloud = quantised(splat.cloud())
        results[splat.name] = {"spz_bytes": size, **compare(cloud, splat.views)}
        print(splat.name, results[splat.name]["auto"], flush=True)
        conditions = {"qps": QPS, "auto_qps": AUTO_QPS, "views": list(FEW)}
        print(write_result("quantised_input", conditions, results))


if __name__ == "__main__":
    main()
