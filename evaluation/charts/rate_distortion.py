"""Rate against distortion: every scene, and all of them together."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.bd import rate_at
from evaluation.charts.style import look, plain_log_axis, shared_legend, write_chart
from evaluation.results_file import Row, curves, measured

Scenes = dict[str, Any]
_COLUMNS = 3
#: the PSNR at which rates are compared when scenes are averaged
_ANCHOR_PSNR = 42.0
_PSNRS = tuple(float(p) for p in range(28, 57, 2))
#: an average over fewer scenes is not drawn
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
        if points:
            rates, psnrs = zip(*sorted(points), strict=True)
            axes.plot([r / 1000 for r in rates], psnrs, label=label, **look(methods[label], label))
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
    on which a method reaches the PSNR. A method that reaches it on other scenes than the rest is still
    comparable, because every scene is measured against ours on the same scene.
    """
    anchors = {
        n: rate_at(curves(s["points"]).get("dfcgs (default)", []), _ANCHOR_PSNR) for n, s in scenes.items()
    }
    found: dict[str, list[tuple[float, float, int]]] = {}
    for label in _methods(scenes):
        for psnr in _PSNRS:
            logs = []
            for name, scene in scenes.items():
                rate, anchor = rate_at(curves(scene["points"]).get(label, []), psnr), anchors[name]
                if rate is not None and anchor is not None:
                    logs.append(math.log(rate / anchor))
            if len(logs) >= _FEWEST_SCENES:
                found.setdefault(label, []).append((float(np.exp(np.mean(logs))), psnr, len(logs)))
    return found


def averaged(scenes: Scenes) -> None:
    """All scenes in one chart."""
    methods, data = _methods(scenes), relative_rates(scenes)
    figure = Figure(figsize=(7.5, 4.8))
    axes = figure.subplots()
    for label, points in data.items():
        axes.plot([p[0] for p in points], [p[1] for p in points], label=label, **look(methods[label], label))
    axes.set_xscale("log", base=2)
    plain_log_axis(axes.xaxis, 2.0)
    axes.set_xlabel("bytes relative to dfcgs (default) at 42 dB, geometric mean over scenes")
    axes.set_ylabel("PSNR, dB")
    axes.legend(fontsize=8)
    write_chart("rate_distortion_average", figure, data)
