"""One look for all charts, and how they are written."""

from __future__ import annotations

import json
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lab.record import REPOSITORY

CHARTS = REPOSITORY / "docs" / "charts"
#: ours in one strong colour, the others told apart by colour and marker (Okabe and Ito's palette)
OURS = "#d55e00"
_LOOKS = {
    "dfcgs": (OURS, "o", "-"),
    "dfcgs_gof10": (OURS, "s", "--"),
    "dfcgs_still": ("#f0a070", "s", "-"),
    "dfcgs_intra": (OURS, "^", ":"),
    "dfcgs_paper": ("#a03000", "x", "--"),
    "dfcgs_uniform": ("#f0a070", "v", ":"),
    "dfcgs_views": ("#000000", "o", "-"),
    "delta_zstd": ("#0072b2", "o", "-"),
    "hevc": ("#009e73", "D", "-"),
    "spz": ("#cc79a7", "P", "-"),
    "spz_gof": ("#cc79a7", "X", "-"),
    "sog": ("#56b4e9", "*", "-"),
    "splats4d": ("#e69f00", "v", "-"),
    "fourdgs": ("#7a5195", "<", "-"),
    "raw_zstd": ("#555555", "h", "-"),
}
_SETTINGS = {
    "svg.hashsalt": "dfcgs-codec",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
}
mpl.rcParams.update(_SETTINGS)


def look(method: str, label: str) -> dict[str, Any]:
    """Arguments for `Axes.plot`; the second GoF of a method is dashed."""
    colour, marker, line = _LOOKS.get(method, ("#999999", ".", "-"))
    dashed = label.endswith("GoF 60")
    return {
        "color": colour,
        "marker": marker,
        "linestyle": "--" if dashed else line,
        "markersize": 4.5,
        "linewidth": 1.8 if method == "dfcgs" else 1.1,
        "markerfacecolor": "white" if dashed else colour,
        "zorder": 3 if method.startswith("dfcgs") else 2,
    }


def plain_log_axis(axis: Axis, base: float = 10.0) -> None:
    """A logarithmic axis with plain numbers at 1, 2, 5 (or at powers of two)."""
    subs = (1.0, 2.0, 5.0) if base == 10.0 else (1.0,)
    axis.set_major_locator(LogLocator(base, subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def shared_legend(figure: Figure, axes: list[Axes], columns: int) -> None:
    """One legend for all panels, below them."""
    entries: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns, fontsize=8)


def write_chart(name: str, figure: Figure, data: Any) -> None:
    """`docs/charts/NAME.svg`, the same for the same figures, and `NAME.json` with what is plotted."""
    CHARTS.mkdir(parents=True, exist_ok=True)
    figure.savefig(CHARTS / f"{name}.svg", metadata={"Date": None, "Creator": None})
    (CHARTS / f"{name}.json").write_text(json.dumps(data, indent=1) + "\n")
    print(CHARTS / f"{name}.svg")
