"""Peak memory of encoding and decoding 300 frames of 200 k Gaussians: `python -m evaluation.memory`.

The frames of a short sequence are linked 300 times under ascending numbers, so that the disk stays small; the
codec reads every one of them.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import GaussianCloud
from dfcgs_codec.ply import read_ply, write_ply
from evaluation.fresh import run_fresh
from lab.assets import find_asset
from lab.record import write_result
from lab.scenes import VARIANTS, SceneOptions, trained_sequence

_GAUSSIANS = 200_000
_FRAMES = 300
_DISTINCT = 6


def _enlarged(cloud: GaussianCloud) -> GaussianCloud:
    """`cloud` repeated, moved a little, to 200 k Gaussians."""
    index = np.arange(_GAUSSIANS) % cloud.num_gaussians
    large = cloud.take(index)
    shift = (np.arange(_GAUSSIANS) // cloud.num_gaussians * 0.01).astype(np.float32)
    return GaussianCloud(
        large.positions + shift[:, None],
        large.rotations,
        large.scales,
        large.opacities,
        large.sh_dc,
        large.sh_rest,
    )


def _make_frames(folder: Path) -> None:
    cloud, _ = read_ply(find_asset("playbot_31k_sh2.ply"))
    clean = trained_sequence(_enlarged(cloud), SceneOptions(_DISTINCT), "part")
    for index, frame in enumerate(VARIANTS["noisy"](clean, 0)):
        write_ply(folder / f"source_{index}.bin", frame)
    # back and forth, so that neighbours in time are neighbours in the short sequence
    period = list(range(_DISTINCT)) + list(range(_DISTINCT - 2, 0, -1))
    for number in range(_FRAMES):
        os.link(folder / f"source_{period[number % len(period)]}.bin", folder / f"frame_{number:04d}.ply")


def _run(arguments: list[str]) -> dict[str, Any]:
    run = run_fresh([sys.executable, "-m", "dfcgs_codec", *arguments])
    return {"exit_code": run.exit_code, "peak_mib": run.peak_mib, "seconds": round(run.seconds, 1)}


def main() -> None:
    """Measure and write the result."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _make_frames(folder)
        target = str(folder / "long.dgs")
        results = {
            "encode": _run(["encode", str(folder), target, "--quiet", "--jobs", "2"]),
            "decode": _run(["decode", target, "--check-only", "--quiet"]),
            "bytes": Path(target).stat().st_size,
        }
    conditions = {"gaussians": _GAUSSIANS, "frames": _FRAMES, "jobs": 2, "memory": "all processes together"}
    print(results)
    print(write_result("memory", conditions, results))


if __name__ == "__main__":
    main()
