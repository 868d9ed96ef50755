"""Speed against accuracy: seconds per frame on one axis, PSNR at a stated rate on the other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.bd import psnr_at
from evaluation.charts.style import OURS, look, write_chart
from evaluation.results_file import Row, curves, families, measured

Scenes = dict[str, Any]
#: the stated rate of a scene: the bytes that this preset takes there
STATED = "high"
_DIRECTIONS = ("encode", "decode")


def _seconds(rows: list[Row], direction: str, gaussians: int) -> float:
    """Median seconds per frame and 100 000 Gaussians over the settings of a curve."""
    return float(np.median([r[f"{direction}_s_per_frame"] for r in rows])) * 1e5 / gaussians


def _stated_rate(scene: Scenes) -> float | None:
    for row in measured(scene["points"]):
        if row["preset"] == STATED:
            return float(row["bytes_per_frame"])
    return None


def scene_points(scene: Scenes) -> dict[str, Row]:
    """By curve label or preset name: seconds, PSNR, and the rate relative to the stated one.

    A method whose curve covers the stated rate stands at its interpolated PSNR there (relative rate 1); one
    that cannot go that low or high stands at its nearest point, with the relative rate beside it. Our presets
    stand at their own points.
    """
    stated = _stated_rate(scene)
    if stated is None:
        return {}
    rows, gaussians = measured(scene["points"]), scene["facts"]["num_gaussians"]
    found: dict[str, Row] = {}
    for label, members in families([r for r in rows if r["psnr"] is not None]).items():
        psnr = psnr_at(curves(rows)[label], stated)
        nearest = min(members, key=lambda r: abs(math.log(r["bytes_per_frame"] / stated)))
        found[label] = {
            "method": members[0]["method"],
            "psnr": nearest["psnr"] if psnr is None else psnr,
            "relative_rate": nearest["bytes_per_frame"] / stated if psnr is None else 1.0,
            **{d: _seconds(members, d, gaussians) for d in _DIRECTIONS},
        }
    for row in rows:
        if row["preset"]:
            found[row["preset"]] = {
                "method": "preset",
                "psnr": row["psnr"],
                "relative_rate": row["bytes_per_frame"] / stated,
                **{d: _seconds([row], d, gaussians) for d in _DIRECTIONS},
            }
    return found


def averaged(scenes: Scenes) -> dict[str, Row]:
    """Over the scenes on which a method ran: mean PSNR, geometric means of the rest, and how many scenes."""
    by_label: dict[str, list[Row]] = {}
    for scene in scenes.values():
        for label, point in scene_points(scene).items():
            by_label.setdefault(label, []).append(point)
    found = {}
    for label, points in by_label.items():
        geometric = {
            k: float(np.exp(np.mean([math.log(p[k]) for p in points])))
            for k in (*_DIRECTIONS, "relative_rate")
        }
        found[label] = {
            "method": points[0]["method"],
            "psnr": float(np.mean([p["psnr"] for p in points])),
            "scenes": len(points),
            **geometric,
        }
    return found


def pareto_front(points: dict[str, Row], direction: str) -> list[str]:
    """Labels of the points at the stated rate that none is faster and better than, by time.

    Points at more than a tenth above the stated rate bought their PSNR with bytes and do not count.
    """
    front: list[str] = []
    best = -math.inf
    for label, point in sorted(points.items(), key=lambda item: item[1][direction]):
        if point["relative_rate"] <= 1.1 and point["psnr"] > best:
            front.append(label)
            best = point["psnr"]
    return front


def _panel(axes: Axes, points: dict[str, Row], direction: str) -> None:
    for label, point in points.items():
        style = look(point["method"], label) | {"linestyle": "none", "markersize": 6.5}
        text = label
        if point["method"] == "preset":
            style |= {"color": OURS, "marker": "o", "markerfacecolor": "white"}
        if abs(math.log(point["relative_rate"])) > math.log(1.1):
            style["markerfacecolor"] = "white"
            text = f"{label} ({point['relative_rate']:.2g}x bytes)"
        axes.plot(point[direction], point["psnr"], **style)
        axes.annotate(text, (point[direction], point["psnr"]), (5, 3), textcoords="offset points", fontsize=7)
    front = [points[label] for label in pareto_front(points, direction)]
    axes.plot([p[direction] for p in front], [p["psnr"] for p in front], color="#999999", lw=1.0, zorder=1)
    axes.set_xscale("log")
    axes.set_xlabel(f"{direction} seconds per frame and 100 k Gaussians")


def chart(scenes: Scenes) -> None:
    """Encoding on the left, decoding on the right."""
    points = averaged(scenes)
    figure = Figure(figsize=(11, 5))
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, direction in zip((left, right), _DIRECTIONS, strict=True):
        _panel(axes, points, direction)
        axes.margins(x=0.2)
    left.set_ylabel(f"PSNR, dB, at the bytes of `{STATED}` (hollow: at other bytes)")
    fronts = {d: pareto_front(points, d) for d in _DIRECTIONS}
    write_chart("speed_accuracy", figure, {"points": points, "pareto": fronts})
