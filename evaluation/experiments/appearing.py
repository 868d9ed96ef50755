"""Is what becomes visible within a GoF as good as in I-frames? `python -m evaluation.experiments.appearing`.

Fails where a frame is below what the preset promises, and below I-frames by more than a bar.

A trained splat whose opacities change over eight frames, at `high`: PSNR of each frame against I-frames only,
and the bytes of both.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.array_types import Float64
from dfcgs_codec.ply import read_ply
from evaluation.experiments.i_frames.surroundings import views
from lab.assets import find_asset
from lab.quality import frame_quality, image, psnr
from lab.record import write_result

NUM_FRAMES = 8
#: decibels that `high` promises, and below I-frames only, at most
PROMISED, MOST_BELOW = 42.0, 1.0
_LESS = 10.0
Less = Callable[[GaussianCloud, int], Float64]


def _half(cloud: GaussianCloud, frame: int) -> Float64:
    return _LESS * (cloud.positions[:, 0] > np.median(cloud.positions[:, 0])) * (frame < 3)


def _fade_in(cloud: GaussianCloud, frame: int) -> Float64:
    return np.full(cloud.num_gaussians, _LESS * (1 - frame / (NUM_FRAMES - 1)))


def _fade_out(cloud: GaussianCloud, frame: int) -> Float64:
    return np.full(cloud.num_gaussians, _LESS * frame / (NUM_FRAMES - 1))


def _bump(cloud: GaussianCloud, frame: int) -> Float64:
    """Each Gaussian shows about a moment of its own."""
    return _LESS * np.abs(frame - np.arange(cloud.num_gaussians) % NUM_FRAMES) / NUM_FRAMES


#: logits of opacity that Gaussians have less, by frame
CHANGES: dict[str, Less] = {"half appears": _half, "fade in": _fade_in, "fade out": _fade_out, "bumps": _bump}


def _coded(frames: list[GaussianCloud], gof_size: int | None) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "a.dgs"
        report = encode_sequence(
            frames, target, EncoderOptions(quality="high", gof_size=gof_size, order="input", jobs=2)
        )
        decoded = [frame.cloud() for frame in decode_sequence(target)]
    cameras = views(frames[0])[:2]
    rated = [
        frame_quality(index, [image(source, camera) for camera in cameras], cloud, cameras).visible.mse
        for index, (source, cloud) in enumerate(zip(frames, decoded, strict=True))
    ]
    kinds = "".join(frame.kind[0] for frame in report.frames)
    return {
        "bytes": report.num_bytes,
        "kinds": kinds,
        "psnr": [round(psnr(mse) or 120.0, 2) for mse in rated],
    }


def _misses(row: dict[str, Any]) -> bool:
    pairs = zip(row["default"]["psnr"], row["intra_only"]["psnr"], strict=True)
    return any(ours < min(PROMISED, intra - MOST_BELOW) for ours, intra in pairs)


def main() -> int:
    """Measure all, write the result, say what missed."""
    cloud, _ = read_ply(find_asset("playbot_31k_sh2.ply"))
    results = {}
    for name, less in CHANGES.items():
        frames = [
            replace(cloud, opacities=(cloud.opacities - less(cloud, index)).astype(np.float32))
            for index in range(NUM_FRAMES)
        ]
        ours, intra = _coded(frames, None), _coded(frames, 1)
        below = max(b - a for a, b in zip(ours["psnr"], intra["psnr"], strict=True))
        results[name] = {"default": ours, "intra_only": intra, "most_below_db": round(below, 2)}
        print(name, results[name], flush=True)
    write_result("appearing", {"quality": "high", "promised_db": PROMISED, "bar_db": MOST_BELOW}, results)
    missed = [name for name, row in results.items() if _misses(row)]
    for name in missed:
        print(f"missed: {name}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
