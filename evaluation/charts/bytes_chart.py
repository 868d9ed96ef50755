"""Where the bytes go."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from evaluation.charts.style import write_chart
from evaluation.curves import measured

_PRESET = "medium"
_COLOURS = {
    "POSITION": "#0072b2",
    "SCALE": "#56b4e9",
    "ROTATION": "#009e73",
    "OPACITY": "#f0e442",
    "SH_DC": "#e69f00",
    "SH_1": "#d55e00",
    "SH_2": "#cc79a7",
    "SH_3": "#7a5195",
}


def shares(scenes: dict[str, Any]) -> dict[str, Any]:
    """By scene: bits per Gaussian and frame by attribute, the rest, and the share of the I-frames."""
    found = {}
    for name, scene in scenes.items():
        row = next((r for r in measured(scene["points"]) if r["preset"] == _PRESET), None)
        if row is None:
            continue
        bits = row["bits_per_gaussian"] / row["bytes"]
        by_attribute = {k: bits * row["bytes_by_attribute"].get(k, 0) for k in _COLOURS}
        found[name] = {
            **by_attribute,
            "other": row["bits_per_gaussian"] - sum(by_attribute.values()),
            "i_frame_share": row["bytes_by_frame_type"].get("I", 0) / row["bytes"],
            "frame_types": row["frame_types"],
        }
    return found


def chart(scenes: dict[str, Any]) -> None:
    """One bar per scene, by attribute."""
    data = shares(scenes)
    figure = Figure(figsize=(9, 0.42 * len(data) + 1.5))
    axes = figure.subplots()
    names = list(data)
    left = dict.fromkeys(names, 0.0)
    for key, colour in {**_COLOURS, "other": "#999999"}.items():
        values = [data[n][key] for n in names]
        axes.barh(names, values, left=[left[n] for n in names], color=colour, label=key, height=0.7)
        left = {n: left[n] + v for n, v in zip(names, values, strict=True)}
    for name in names:
        axes.text(
            left[name], name, f"  I-frames {100 * data[name]['i_frame_share']:.0f} %", va="center", fontsize=7
        )
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.margins(x=0.15)
    axes.set_xlabel(f"bits per Gaussian and frame at `{_PRESET}`")
    axes.legend(ncols=3, fontsize=7, loc="lower right")
    write_chart("where_the_bytes_go", figure, data)
