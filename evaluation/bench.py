"""The comparison: every method at every setting on every evaluation scene that is an object.

    python -m evaluation.bench           20 frames (two scenes 60), every fifth rendered from 3 views
    python -m evaluation.bench --full    every fifth frame from all 8 views
    python -m evaluation.bench --quick   4 scenes, 6 frames, our presets and the quick baselines

Figures land in `evaluation/results/bench.json` (`bench_full.json`, `bench_quick.json`) after every scene.
What was measured before of the same input by the same code is taken from the cache under `out/bench`, so that
a run that was interrupted goes on where it stopped. Methods and scenes that are not on this machine are
skipped with a notice. `evaluation.captures` runs the same on ten frames of captures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from collections.abc import Sequence as Arguments
from dataclasses import asdict, dataclass
from typing import Any

from evaluation.baselines.catalogue import METHODS
from evaluation.baselines.method import MethodUnavailable
from evaluation.measure import Rated, Subject, measure
from evaluation.points import CODEC_CURVES, Point, baseline_points, capture_points, codec_points
from evaluation.sequences import materialise
from lab.assets import present
from lab.captures.files import cameras_file
from lab.record import known_results, write_result
from lab.scenes.catalogue import Group, Scene, group, is_capture
from lab.views import ANGLES, FEW

_RENDER_EVERY = 5


@dataclass(frozen=True)
class Plan:
    """One kind of run. max_frames None: all frames of a scene; scenes and methods empty: all.

    Captures are asked more than objects: `evaluation.points.capture_points`.
    """

    result: str
    views: tuple[int, ...]
    max_frames: int | None = None
    scenes: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    group: Group = "evaluation"


PLANS = {
    "bench": Plan("bench", FEW),
    "full": Plan("bench_full", tuple(range(len(ANGLES)))),
    "quick": Plan(
        "bench_quick",
        FEW,
        6,
        ("playbot_sway_drift", "playbot_twist_semi", "knight_walk", "mage_fitted"),
        ("dfcgs", "delta_zstd", "spz"),
    ),
    "captures": Plan(
        "captures",
        tuple(range(len(ANGLES))),
        10,
        methods=("dfcgs", "dfcgs_uniform", "dfcgs_views", "delta_zstd"),
        group="captures",
    ),
}


def chosen_scenes(plan: Plan, wanted: Arguments[str]) -> list[Scene]:
    """Those of a plan that are wanted (empty: all) and on this machine."""
    planned = [scene for scene in group(plan.group) if not plan.scenes or scene.name in plan.scenes]
    return list(present(planned, wanted))


def chosen_points(plan: Plan, wanted: Arguments[str], scene: Scene) -> list[Point]:
    """Those of the wanted methods, or of the plan's, or all, on a scene."""
    more = capture_points(cameras_file(scene.name)) if is_capture(scene.name) else []
    methods = wanted or plan.methods
    points = [*codec_points(), *more, *baseline_points()]
    return [point for point in points if not methods or point.method in methods]


def _line(point: Point, figures: dict[str, Any]) -> str:
    name = f"{point.method:14s} {point.setting:16s}"
    if "bytes" not in figures:
        return f"  {name} {figures.get('skipped') or figures.get('failed')}"
    psnr = figures["psnr"]
    quality = "equal images" if psnr is None else f"{psnr:6.2f} dB, worst {figures['psnr_worst_frame']:6.2f}"
    times = f"{figures['encode_s_per_frame']:.2f} / {figures['decode_s_per_frame']:.2f} s"
    return f"  {name} {figures['bytes_per_frame'] / 1000:9.1f} kB/frame  {quality}  {times}"


def subject_of(scene: Scene, max_frames: int | None, views: tuple[int, ...]) -> Subject:
    sequence = materialise(scene, max_frames)
    return Subject(sequence, Rated(tuple(range(0, sequence.facts.num_frames, _RENDER_EVERY)), views))


def bench_scene(
    scene: Scene,
    plan: Plan,
    points: Arguments[Point],
    keep: Callable[[dict[str, Any]], object] = lambda _: None,
) -> dict[str, Any]:
    """All points of a scene; `keep` is called with what there is after each."""
    subject = subject_of(scene, plan.max_frames, plan.views)
    sequence = subject.sequence
    print(scene.name, flush=True)
    facts = asdict(sequence.facts) | {"num_gaussians": max(sequence.facts.num_gaussians)}
    found = {"facts": facts, "input_sha256": sequence.digest, "rendered_frames": subject.rated.frames}
    rows: list[dict[str, Any]] = []
    for point in points:
        rated = subject if point.sample is None else subject_of(scene, point.sample, plan.views)
        figures = measure(rated, point)
        print(_line(point, figures), flush=True)
        about = {"method": point.method, "label": point.label, "setting": point.setting}
        about |= {"preset": point.preset, "version": _version(point), "sample_frames": point.sample}
        rows.append(about | figures)
        keep(found | {"points": list(rows)})
    return found | {"points": rows}


def _version(point: Point) -> str:
    try:
        return point.version()
    except MethodUnavailable as error:
        return str(error)


def merged(old: dict[str, Any] | None, new: dict[str, Any]) -> dict[str, Any]:
    """New points, and of the old ones those of methods that this run left out, if the input is the same.

    Points of methods that there are no more are dropped; methods stay in their usual order.
    """
    if old is None or old["input_sha256"] != new["input_sha256"]:
        return new
    order = [*CODEC_CURVES, *METHODS]
    left = set(order) - {row["method"] for row in new["points"]}
    points = [*new["points"], *(row for row in old["points"] if row["method"] in left)]
    return new | {"points": sorted(points, key=lambda row: order.index(row["method"]))}


def conditions(plan: Plan) -> dict[str, Any]:
    """How a plan measures."""
    return {"plan": asdict(plan), "render_every": _RENDER_EVERY, "cores": 2}


def main(arguments: Arguments[str] | None = None) -> None:
    """Run a plan and write its result after every scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_const", const="full", dest="plan", default="bench")
    parser.add_argument("--quick", action="store_const", const="quick", dest="plan")
    parser.add_argument("--scenes", nargs="*", default=[], help="only these")
    parser.add_argument("--methods", nargs="*", default=[], help="only these")
    args = parser.parse_args(arguments)
    plan = PLANS[args.plan]
    results = known_results(plan.result)
    for scene in chosen_scenes(plan, args.scenes):
        new = bench_scene(scene, plan, chosen_points(plan, args.methods, scene))
        results[scene.name] = merged(results.get(scene.name), new)
        path = write_result(plan.result, conditions(plan), results)
    print(path)


if __name__ == "__main__":
    main()
