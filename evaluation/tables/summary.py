"""The figures in README.md."""

from __future__ import annotations

import numpy as np

from evaluation.curves import kinds
from evaluation.tables.comparison import OURS, TOLD, compared_scenes, differences, labels, percent
from evaluation.tables.markdown import table
from evaluation.tables.single import memory
from lab.record import results

#: head of a column -> kind of scenes, our curve
_COLUMNS = {
    "captures, `--views`": ("captures", TOLD),
    "captures": ("captures", OURS),
    "objects": ("objects", OURS),
}


def _cell(logarithms: list[float]) -> str:
    """Geometric mean, best and worst scene."""
    if not logarithms:
        return "-"
    mean, best, worst = (percent(f(logarithms)) for f in (lambda x: float(np.mean(x)), min, max))
    return f"**{mean}** ({best} to {worst})"


def summary_table() -> str:
    """Our bytes against those of every baseline at equal PSNR, of captures and of objects apart."""
    scenes = kinds(compared_scenes())
    rows = []
    for label in labels(compared_scenes()):
        cells = [_cell(differences(scenes.get(kind, {}), label, ours)[1]) for kind, ours in _COLUMNS.values()]
        if set(cells) != {"-"}:
            rows.append([label, *cells])
    return table(["bytes against", *_COLUMNS], rows) + _seconds()


def _seconds() -> str:
    speed = results("speed")["character_200k"]
    times = f"encodes in {speed['encode_p_s']:.2f} s and decodes in {speed['decode_p_s']:.2f} s"
    frame = "a walking character (200 k Gaussians, SH degree 3)"
    return f"\nA P-frame of {frame} {times} on one core.\n{memory()}"
