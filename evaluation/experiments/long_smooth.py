"""Smooth tracked scenes of 60 frames against quantised delta + zstd.

    python -m evaluation.experiments.long_smooth

The scenes of the comparison have 20 frames where they are large, which are mostly their I-frame. Here the
same scenes go on for 60. Bytes of whole files at equal PSNR; what was measured before by the same code is
taken from the cache of `evaluation.bench`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence as Arguments
from dataclasses import replace
from typing import Any

from evaluation.bd import bd_delta
from evaluation.bench import PLANS, bench_scene, merged
from evaluation.curves import curves
from evaluation.points import Point, baseline_points, codec_points
from lab.assets import present
from lab.record import known_results, write_result
from lab.scenes.catalogue import scene as named_scene

NUM_FRAMES = 60
SCENES = ("knight_walk", "plant_sway", "sushi_part", "mage_spell")
_OURS = "dfcgs (default)"
_METHODS = ("dfcgs", "delta_zstd")
#: beyond what the others reach
_LEFT_OUT = ("transparent", "qp40")

Figures = dict[str, Any]


def points(methods: Arguments[str] = _METHODS) -> list[Point]:
    """Our presets and the baseline's sweep."""
    found = [*codec_points(), *baseline_points()]
    return [point for point in found if point.method in methods and point.setting not in _LEFT_OUT]


def ratios(rows: list[Figures]) -> dict[str, float]:
    """Our bytes as a part of each curve's at equal PSNR."""
    found = curves(rows)
    deltas = {label: bd_delta(curve, found[_OURS]) for label, curve in found.items() if label != _OURS}
    return {label: round(1 + d.bd_rate / 100, 4) for label, d in deltas.items() if d is not None}


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), help="only these")
    parser.add_argument("--methods", nargs="*", default=list(_METHODS), help="only these")
    args = parser.parse_args(arguments)
    results = known_results("long_smooth")
    for scene in present(replace(named_scene(name), num_frames=NUM_FRAMES) for name in args.scenes):
        name = scene.name
        found = merged(results.get(name), bench_scene(scene, PLANS["bench"], points(args.methods)))
        results[name] = {"ratios": ratios(found["points"])} | found
        print(name, results[name]["ratios"], flush=True)
        path = write_result("long_smooth", {"frames": NUM_FRAMES}, results)
    print(path)


if __name__ == "__main__":
    main()
