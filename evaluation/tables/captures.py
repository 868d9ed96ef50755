"""Tables of captures, and of what presets promise on all scenes, for `docs/results.md`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evaluation.curves import Row, kinds, measured
from evaluation.tables.markdown import decibel, table
from lab.record import results

#: curves whose rows are named presets
_PRESET_METHODS = ("dfcgs", "dfcgs_views")


def bytes_table() -> str:
    """Bytes of every curve of ours at equal PSNR, as a part of uniform steps' and of the baseline's."""
    scenes = results("captures")
    pairs: dict[tuple[str, str], dict[str, float]] = {}
    for name, scene in scenes.items():
        for label, anchors in scene["against"].items():
            for anchor, figures in anchors.items():
                pairs.setdefault((label, anchor), {})[name] = figures["bytes_ratio"]
    rows = []
    for (label, anchor), ratios in pairs.items():
        mean = math.exp(float(np.mean(np.log(list(ratios.values())))))
        cells = [f"{ratios[name]:.2f}" if name in ratios else "-" for name in scenes]
        rows.append([label, anchor, *cells, f"{mean:.2f}"])
    return table(["curve", "as a part of", *scenes, "mean"], rows)


def truth_table() -> str:
    """Presets against the input, and against the true images that the input was fitted to."""
    rows = []
    for name, scene in results("captures").items():
        for row in measured(scene["points"]):
            if row["method"] not in _PRESET_METHODS or row["setting"].startswith("qp"):
                continue
            rows.append(
                [
                    name,
                    f"`{row['setting']}`" + (", told its cameras" if row["method"] == "dfcgs_views" else ""),
                    f"{row['bytes_per_frame'] / 1000:.1f}",
                    decibel(row["psnr"], "-"),
                    decibel(row["psnr_worst_frame"], "-"),
                    f"{decibel(row['psnr_true_decoded'], '-')} ({decibel(row['psnr_true_input'], '-')})",
                    f"{row['ssim_true_decoded']:.4f} ({row['ssim_true_input']:.4f})",
                ]
            )
    head = ["capture", "preset", "kB per frame", "PSNR, dB", "worst frame, dB"]
    return table([*head, "against the truth, dB (input)", "SSIM against the truth (input)"], rows)


def _promise_cell(row: Row | None) -> str:
    """PSNR, how far the worst frame is below, and how far off the encoder's estimate is."""
    if row is None or row["psnr"] is None:
        return "-" if row is None else "equal images"
    expected = row["estimated_psnr"]
    off = "" if expected is None else f", expected {expected - row['psnr']:+.1f}"
    return f"{row['psnr']:.1f} dB, worst {row['worst_minus_mean']:+.1f}{off}"


def _promise_summary(scenes: dict[str, Any], setting: str) -> str:
    """Least PSNR of scenes, and mean and largest error of the estimates."""
    found = [scene[setting] for scene in scenes.values() if scene.get(setting, {}).get("psnr") is not None]
    if not found:
        return "-"
    errors = [abs(r["estimated_psnr"] - r["psnr"]) for r in found if r["estimated_psnr"] is not None]
    off = f", off by {np.mean(errors):.1f}, {max(errors):.1f} at most" if errors else ""
    return f"{min(row['psnr'] for row in found):.1f} dB at least{off}"


def promise_table() -> str:
    """PSNR of every scene by preset, beside what the encoder expects; summed up by kind."""
    scenes = results("promise")
    settings = list(dict.fromkeys(setting for scene in scenes.values() for setting in scene))
    rows = []
    for kind, members in kinds(scenes).items():
        rows += [[name, *(_promise_cell(scene.get(s)) for s in settings)] for name, scene in members.items()]
        rows.append([f"**{kind}**", *(_promise_summary(members, setting) for setting in settings)])
    return table(["scene", *(f"`{setting}`" for setting in settings)], rows)
