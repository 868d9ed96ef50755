"""Drift over 300 frames at several GoF sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from evaluation.charts.style import write_chart

_COLOURS = {
    "gof4": "#cc79a7",
    "gof10": "#56b4e9",
    "gof32": "#009e73",
    "gof60": "#e69f00",
    "gof300": "#d55e00",
}
#: frames of the moving average that is drawn over the single frames
_WINDOW = 9


def chart(scenes: dict[str, Any]) -> None:
    """PSNR minus that of all-intra coding at the same QP, frame by frame."""
    figure = Figure(figsize=(11, 4))
    panels = figure.subplots(1, len(scenes), squeeze=False, sharey=True)[0]
    data: dict[str, Any] = {}
    for axes, (name, scene) in zip(panels, scenes.items(), strict=True):
        intra = np.array(scene["intra"]["psnr"])
        for key, colour in _COLOURS.items():
            if key not in scene:
                continue
            difference = np.array(scene[key]["psnr"]) - intra
            smooth = np.convolve(difference, np.full(_WINDOW, 1 / _WINDOW), "valid")
            share = scene[key]["bytes"] / scene["intra"]["bytes"]
            label = f"{key.removeprefix('gof')}: {100 * share:.0f} %"
            axes.plot(difference, color=colour, lw=0.4, alpha=0.5)
            axes.plot(np.arange(len(smooth)) + _WINDOW // 2, smooth, color=colour, lw=1.4, label=label)
            data.setdefault(name, {})[key] = np.round(difference, 4).tolist()
        axes.axhline(0, color="#555555", lw=0.8)
        axes.set_title(name)
        axes.set_xlabel("frame")
        axes.legend(
            title="GoF: share of all-intra's bytes",
            title_fontsize=7,
            fontsize=7,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.16),
            ncols=3,
        )
    panels[0].set_ylabel("PSNR minus all-intra, dB")
    write_chart("drift", figure, data)
