"""Rate against distortion: every scene, and all of them together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.bd import rate_at, rising
from evaluation.charts.style import look, plain_log_axis, shared_legend, write_chart
from evaluation.curves import Row, curves, measured

Scenes = dict[str, Any]
_COLUMNS = 3
#: the PSNR at which rates are compared when scenes are averaged
_ANCHOR_PSNR = 42.0
_PSNRS = tuple(float(p) for p in range(28, 57, 2))
#: an average over fewer scenes is not drawn, unless there are no more
_FEWEST_SCENES = 3


def _methods(scenes: Scenes) -> dict[str, str]:
    """Method by curve label."""
    found: dict[str, str] = {}
    for scene in scenes.values():
        rows: list[Row] = measured(scene["points"])
        for label in curves(rows):
            name = label.split(", GoF ")[0]
            found.setdefault(label, next(r["method"] for r in rows if r["label"] in (label, name)))
    return found


def _panel(axes: Axes, scene: Scenes, methods: dict[str, str]) -> None:
    for label, points in curves(scene["points"]).items():
        style = look(methods[label], label)
        for members, line in ((sorted(points), "none"), (rising(points), style["linestyle"])):
            rates, psnrs = [r / 1000 for r, _ in members], [p for _, p in members]
            # settings that a cheaper one beats are points beside the curve
            axes.plot(rates, psnrs, label=label, **style | {"linestyle": line})
    axes.set_xscale("log")
    plain_log_axis(axes.xaxis)
    axes.set_ylim(24, 66)


def per_scene(scenes: Scenes) -> None:
    """Small multiples, one scene each."""
    methods = _methods(scenes)
    rows = math.ceil(len(scenes) / _COLUMNS)
    figure = Figure(figsize=(11, 2.7 * rows + 0.9))
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharey=True)
    flat: list[Axes] = list(panels.ravel())
    for axes, (name, scene) in zip(flat, scenes.items(), strict=False):
        facts = scene["facts"]
        _panel(axes, scene, methods)
        axes.set_title(f"{name}\n{facts['num_gaussians'] // 1000} k, SH {facts['sh_degree']}", fontsize=9)
    for axes in flat[len(scenes) :]:
        axes.set_visible(False)
    for row in panels:
        row[0].set_ylabel("PSNR, dB")
    for axes in flat[max(0, len(scenes) - _COLUMNS) : len(scenes)]:
        axes.set_xlabel("kB per frame")
    shared_legend(figure, flat, 4)
    write_chart("rate_distortion", figure, {n: curves(s["points"]) for n, s in scenes.items()})


def relative_rates(scenes: Scenes) -> dict[str, list[tuple[float, float, int]]]:
    """By curve: (mean relative rate, PSNR, number of scenes).

    A scene's rates are divided by the default codec's at 42 dB, then averaged geometrically over the scenes
    on which a method reaches 42 dB, at the PSNRs that it reaches on all of them. Methods that code other
    scenes are still comparable, because each scene is measured against ours on the same scene.
    """
    anchors = {
        n: rate_at(curves(s["points"]).get("dfcgs (default)", []), _ANCHOR_PSNR) for n, s in scenes.items()
    }
    found: dict[str, list[tuple[float, float, int]]] = {}
    for label in _methods(scenes):
        points = {n: curves(s["points"]).get(label, []) for n, s in scenes.items() if anchors[n]}
        points = {n: p for n, p in points.items() if rate_at(p, _ANCHOR_PSNR) is not None}
        if len(points) < min(_FEWEST_SCENES, len(scenes)):
            continue
        for psnr in _PSNRS:
            rates = [(rate_at(p, psnr), anchors[n]) for n, p in points.items()]
            logs = [math.log(rate / anchor) for rate, anchor in rates if rate and anchor]
            if len(logs) == len(points):
                found.setdefault(label, []).append((float(np.exp(np.mean(logs))), psnr, len(logs)))
    return found


def averaged(scenes: Scenes, suffix: str = "") -> None:
    """All scenes of a kind in one chart, `rate_distortion_average` with the suffix; none without curves."""
    methods, data = _methods(scenes), relative_rates(scenes)
    if not data:
        return
    figure = Figure(figsize=(7.5, 4.8))
    axes = figure.subplots()
    for label, points in data.items():
        axes.plot([p[0] for p in points], [p[1] for p in points], label=label, **look(methods[label], label))
    axes.set_xscale("log", base=2)
    plain_log_axis(axes.xaxis, 2.0)
    axes.set_xlabel("bytes relative to dfcgs (default) at 42 dB, geometric mean over scenes")
    axes.set_ylabel("PSNR, dB")
    axes.legend(fontsize=8)
    write_chart(f"rate_distortion_average{suffix}", figure, data)
