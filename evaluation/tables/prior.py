"""Tables of the frozen prior for `docs/results.md`."""

from __future__ import annotations

import math
from typing import Any

from evaluation.experiments.prior import ABLATED, MEDIUM
from evaluation.tables.markdown import table
from lab.record import results

#: models in the order of the table -> how they are called there
_MODELS = {
    "main-1": "`main-1`, both hidden layers of 16",
    "width-16": "16, trained as long as those below",
    "width-8": "8",
    "width-32": "32",
    "without-kinds": "without kinds and fractions",
    "without-spatial": "without neighbours",
    "without-temporal": "without earlier frames",
    "without-motion": "without what motion did",
    "without-visibility": "without visibility",
    "without-classes": "without classes of blocks (z)",
    "without-attributes": "without other attributes",
    "without-level": "without the control point's level",
    "as-plain": "contexts of plain streams, tables frozen",
}


def _change(new: float, old: float) -> str:
    return f"{100 * (new / old - 1):+.1f} %" if old else "-"


def _mean(ratios: list[float]) -> str:
    """Geometric mean as a change."""
    if not ratios:
        return "-"
    return f"{100 * (math.exp(sum(map(math.log, ratios)) / len(ratios)) - 1):+.1f} %"


def streams_table() -> str:
    """Bytes of the same symbols with the prior and without, and P-frames at equal PSNR."""
    rows, ratios = [], {part: [] for part in ("motion", "residual")}  # type: dict[str, list[float]]
    for name, scene in results("prior")["scenes"].items():
        cells = []
        for part in ratios:
            for qp, found in scene["streams"].items():
                plain, prior = found.get(f"{part} plain", 0), found.get(f"{part} prior", 0)
                if plain and int(float(qp)) == MEDIUM:
                    cells.append(f"{plain / 1000:.1f} kB, {_change(prior, plain)}")
                elif int(float(qp)) == MEDIUM:
                    cells.append("-")
                if plain:
                    ratios[part].append(prior / plain)
        curves = [scene["bd_rate_bytes_p"], scene["bd_rate_bytes"]]
        rows.append([name, *cells, *("-" if rate is None else f"{rate:+.1f} %" for rate in curves)])
    rows.append(["mean, all QPs", *(_mean(found) for found in ratios.values()), "", ""])
    head = ["scene", "motion, QP 28", "residual, QP 28", "P-frames at equal PSNR", "files at equal PSNR"]
    return table(head, rows)


def _ratios(found: dict[str, Any], part: str, model: str) -> list[float]:
    pairs = [(found[scene][model], found[scene]["main-1"]) for scene in ABLATED if scene in found]
    return [a[f"{part} prior"] / b[f"{part} prior"] for a, b in pairs if b.get(f"{part} prior")]


def models_table() -> str:
    """Other models against the package's: bytes of all streams with the prior, four scenes, QP 28."""
    found = results("prior").get("models", {})
    rows = []
    for model, label in _MODELS.items():
        if not found or not all(model in scene for scene in found.values()):
            continue
        rows.append([label, *(_mean(_ratios(found, part, model)) for part in ("motion", "residual"))])
    return table(["model", "motion", "residual"], rows)
