"""The comparison on captures: `python -m evaluation.captures [SCENE...] [--methods NAME...]`.

Our presets, told where the cameras stood and not; uniform steps; quantised delta + zstd. Of ten frames every
fifth is rendered from the eight views between the cameras of the fit. PSNR counts whole images, against the
input and against the true images that the input was fitted to. `against`: bytes at equal PSNR, of each curve
as a part of those of uniform steps and of the baseline. Figures land in `evaluation/results/captures.json`
after every row; `evaluation.bench` says what is taken from the cache. `--methods` may name any of the
comparison.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence as Arguments
from typing import Any

from evaluation.bd import bd_delta
from evaluation.bench import PLANS, bench_scene, chosen_points, chosen_scenes, conditions, merged
from evaluation.curves import curves, measured
from evaluation.points import CODEC_CURVES
from lab.record import known_results, write_result
from lab.scenes.catalogue import group

PLAN = PLANS["captures"]
#: what the curves are compared with
ANCHORS = ("dfcgs_uniform", "delta_zstd")

Figures = dict[str, Any]


def against(rows: list[Figures]) -> dict[str, dict[str, Figures]]:
    """By curve of ours and anchor: bytes as a part of the anchor's at equal PSNR, decibel at equal bytes."""
    found = curves(rows)
    anchors = {row["label"] for row in measured(rows) if row["method"] in ANCHORS}
    ours = {label for label, _ in CODEC_CURVES.values()}
    result: dict[str, dict[str, Figures]] = {}
    for label in (label for label in found if label in ours):
        for anchor in (a for a in found if a != label and a.split(", GoF ")[0] in anchors):
            if (delta := bd_delta(found[anchor], found[label])) is not None:
                result.setdefault(label, {})[anchor] = {
                    "bytes_ratio": round(1 + delta.bd_rate / 100, 4),
                    "bd_psnr": None if delta.bd_psnr is None else round(delta.bd_psnr, 2),
                    "overlap_db": round(delta.overlap, 1),
                }
    return result


def main(arguments: Arguments[str] | None = None) -> None:
    """Measure the captures that are there, and write the result after every row."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    names = [scene.name for scene in group(PLAN.group)]
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"only these of {', '.join(names)}")
    parser.add_argument("--methods", nargs="*", default=[], help=f"instead of {', '.join(PLAN.methods)}")
    args = parser.parse_args(arguments)
    if unknown := set(args.scenes) - set(names):
        parser.error(f"no capture {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    results = known_results(PLAN.result)
    for scene in chosen_scenes(PLAN, args.scenes):
        before = results.get(scene.name)

        def keep(found: Figures, name: str = scene.name, before: Figures | None = before) -> None:
            whole = merged(before, found)
            results[name] = {"against": against(whole["points"])} | whole
            write_result(PLAN.result, conditions(PLAN), results)

        bench_scene(scene, PLAN, chosen_points(PLAN, args.methods, scene), keep)
        for label, ratios in results[scene.name]["against"].items():
            print(f"  {label}:", *(f"{r['bytes_ratio']:.3f} of {anchor}" for anchor, r in ratios.items()))


if __name__ == "__main__":
    main()
