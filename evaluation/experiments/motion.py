"""What motion is worth, and its parts: ablations and sensitivity, as the paper's tables have them.

    python -m evaluation.experiments.motion [--frames N] [--scenes NAME ...] [--variants NAME ...]

Every variant of the encoder on the first frames of every evaluation scene that has P-frames, at three QPs,
against the default: bytes at equal PSNR of whole files and of P-frames alone. Figures land in
`evaluation/results/motion.json` after every scene; what was measured before by the same code is taken from
the cache of `evaluation.bench`. Lengths of GoFs are `evaluation.experiments.drift`'s.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence as Arguments
from typing import Any

from evaluation.bd import bd_delta
from evaluation.bench import PLANS, subject_of
from evaluation.measure import Subject, measure
from evaluation.points import CURVE_QPS, Point, codec_point
from lab.assets import present
from lab.record import known_results, write_result
from lab.scenes.catalogue import group

_DEFAULT = "default"
#: EncoderTuning by variant
VARIANTS: dict[str, dict[str, Any]] = {
    "no motion": {"motion": "off"},
    "no residual": {"motion": "only"},
    "uniform steps": {"visibility": False},
    "M = 35": {"control_spacing": 35},
    "M = 140": {"control_spacing": 140},
    "M = 280": {"control_spacing": 280},
    "translation only": {"turns": False},
}
#: scenes without anything to predict
_WITHOUT_MOTION = ("plant_bend_untracked",)

Figures = dict[str, Any]


def variant_point(variant: str, qp: int) -> Point:
    """A variant at a QP."""
    return codec_point("dfcgs", f"{variant}, qp{qp}", {"qp": qp, "tuning": VARIANTS.get(variant, {})})


def _points(subject: Subject, variant: str) -> list[Figures]:
    """Figures of a variant at every QP."""
    rows = [measure(subject, variant_point(variant, qp)) for qp in CURVE_QPS]
    return [row for row in rows if "bytes" in row]


def _inter_bytes(row: Figures) -> float:
    return float(sum(size for kind, size in row["bytes_by_frame_type"].items() if kind != "I"))


def compare(default: list[Figures], rows: list[Figures]) -> Figures:
    """Bytes at equal PSNR against the default, in percent, of whole files and of P-frames; more at QP 28."""
    found: Figures = {"bytes": [row["bytes"] for row in rows], "psnr": [row["psnr"] for row in rows]}
    for name, size in (("file", lambda row: row["bytes"]), ("inter", _inter_bytes)):
        delta = bd_delta([(size(r), r["psnr"]) for r in default], [(size(r), r["psnr"]) for r in rows])
        found[f"bd_rate_{name}"] = None if delta is None else round(delta.bd_rate, 2)
    medium = rows[1] if len(rows) == len(CURVE_QPS) else rows[0]
    return found | {
        "frame_types": medium["frame_types"],
        "bytes_by_attribute": medium["bytes_by_attribute"],
    }


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20, help="of every scene, at most")
    parser.add_argument("--scenes", nargs="*", default=[], help="only these")
    parser.add_argument("--variants", nargs="*", default=list(VARIANTS), help="only these")
    args = parser.parse_args(arguments)
    plan = PLANS["bench"]
    results = known_results("motion")
    moving = [scene for scene in group("evaluation") if scene.name not in _WITHOUT_MOTION]
    for scene in present(moving, args.scenes):
        subject = subject_of(scene, args.frames, plan.views)
        default = _points(subject, _DEFAULT)
        found = results.setdefault(scene.name, {})
        found[_DEFAULT] = compare(default, default)
        for variant in args.variants:
            found[variant] = compare(default, _points(subject, variant))
            print(
                scene.name,
                variant,
                found[variant]["bd_rate_file"],
                found[variant]["bd_rate_inter"],
                flush=True,
            )
        path = write_result(
            "motion", {"frames": args.frames, "qps": CURVE_QPS, "variants": VARIANTS}, results
        )
    print(path)


if __name__ == "__main__":
    main()
