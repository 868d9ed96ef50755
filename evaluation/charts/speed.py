"""Speed against accuracy: seconds per frame on one axis, PSNR at a stated rate on the other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.bd import psnr_at
from evaluation.charts.style import OURS, look, plain_log_axis, write_chart
from evaluation.curves import Row, curves, families, measured

Scenes = dict[str, Any]
#: the stated rate of a scene: the bytes that this preset takes there
STATED = "high"
_DIRECTIONS = ("encode", "decode")
_DEFAULT = "dfcgs (default)"


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
    """Over the scenes on which a method ran, each measured against our preset `high` on the same scene.

    PSNR is our mean plus the mean difference, seconds our geometric mean times that of the ratios, so that
    methods that cannot code every scene stay comparable.
    """
    by_scene = [points for points in map(scene_points, scenes.values()) if points]
    own = [points[STATED] for points in by_scene]
    base = {"psnr": float(np.mean([p["psnr"] for p in own]))}
    base |= {d: float(np.exp(np.mean([math.log(p[d]) for p in own]))) for d in _DIRECTIONS}
    found: dict[str, Row] = {}
    for label in dict.fromkeys(label for points in by_scene for label in points):
        pairs = [(points[label], points[STATED]) for points in by_scene if label in points]
        found[label] = {
            "method": pairs[0][0]["method"],
            "scenes": len(pairs),
            "psnr": base["psnr"] + float(np.mean([a["psnr"] - b["psnr"] for a, b in pairs])),
            "relative_rate": float(np.exp(np.mean([math.log(a["relative_rate"]) for a, _ in pairs]))),
        }
        for d in _DIRECTIONS:
            ratio = float(np.exp(np.mean([math.log(a[d] / b[d]) for a, b in pairs])))
            found[label][d] = base[d] * ratio
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


def _text(label: str, point: Row) -> str:
    rate = point["relative_rate"]
    return f"{label} ({rate:.2g}x bytes)" if _is_elsewhere(point) else label


def _is_elsewhere(point: Row) -> bool:
    """Whether a point is not at the stated rate."""
    return abs(math.log(point["relative_rate"])) > math.log(1.1)


def _label_heights(points: dict[str, Row]) -> dict[str, float]:
    """Where labels stand: at their points, moved up where the one below would be hit."""
    gap = 0.03 * (max(p["psnr"] for p in points.values()) - min(p["psnr"] for p in points.values()))
    heights: dict[str, float] = {}
    below = -math.inf
    for label, point in sorted(points.items(), key=lambda item: item[1]["psnr"]):
        below = max(point["psnr"], below + gap)
        heights[label] = below
    return heights


def _panel(axes: Axes, points: dict[str, Row], direction: str) -> None:
    heights = _label_heights(points)
    for label, point in points.items():
        style = look(point["method"], label) | {"linestyle": "none", "markersize": 6.5}
        if point["method"] == "preset":
            style |= {"color": OURS, "marker": "o", "markerfacecolor": OURS}
        if _is_elsewhere(point):
            style["markerfacecolor"] = "white"
        axes.plot(point[direction], point["psnr"], **style)
        axes.annotate(
            _text(label, point),
            (point[direction], point["psnr"]),
            (point[direction] * 1.09, heights[label]),
            fontsize=7,
            va="center",
            arrowprops={"arrowstyle": "-", "color": "#bbbbbb", "lw": 0.5},
        )
    front = [points[label] for label in pareto_front(points, direction)]
    axes.plot([p[direction] for p in front], [p["psnr"] for p in front], color="#999999", lw=1.0, zorder=1)
    axes.set_xscale("log")
    plain_log_axis(axes.xaxis)
    low, high = (f(p[direction] for p in points.values()) for f in (min, max))
    axes.set_xlim(low / 1.3, high * 2.5)
    axes.set_xlabel(f"{direction} seconds per frame and 100 k Gaussians")


def chart(scenes: Scenes, suffix: str = "") -> None:
    """Encoding on the left, decoding on the right, in `speed_accuracy` with the suffix."""
    if not any(map(scene_points, scenes.values())):
        return
    points = averaged(scenes)
    # our default curve at the stated rate is the preset itself
    points.pop(_DEFAULT, None)
    figure = Figure(figsize=(12, 6.5))
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, direction in zip((left, right), _DIRECTIONS, strict=True):
        _panel(axes, points, direction)
    left.set_ylabel(f"PSNR, dB, at the bytes of `{STATED}` (hollow: at other bytes)")
    fronts = {d: pareto_front(points, d) for d in _DIRECTIONS}
    write_chart(f"speed_accuracy{suffix}", figure, {"points": points, "pareto": fronts})
