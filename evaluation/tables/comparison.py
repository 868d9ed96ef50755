"""Tables of the comparison: every method on every scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evaluation.bd import bd_delta, rate_at
from evaluation.curves import curves, kinds, measured
from evaluation.tables.markdown import decibel, table
from lab.record import known_results, results

OURS, STILL, TOLD = "dfcgs (default)", "dfcgs, no motion", "dfcgs, told its cameras"
_SHORT = "dfcgs, GoF 10"
_PRESETS = ("low", "medium", "high", "transparent")


def compared_scenes() -> dict[str, Any]:
    """Scenes of the comparison: objects, and captures where they were measured."""
    return results("bench") | known_results("captures")


def _by_kind(made: Callable[[dict[str, Any]], str]) -> str:
    """A table of captures and, below, one of objects; without heads where there is one kind alone."""
    parts = {kind: made(scenes) for kind, scenes in kinds(compared_scenes()).items()}
    if len(parts) == 1:
        return "".join(parts.values())
    return "\n".join(f"{kind.capitalize()}:\n\n{parts[kind]}" for kind in ("captures", "objects"))


def against(scene: dict[str, Any], label: str) -> str:
    """Our bytes against a curve's at equal PSNR: BD-rate, or for one point the difference at its PSNR (*)."""
    found = curves(scene["points"])
    ours, theirs = found.get(OURS, []), found.get(label, [])
    if label not in found:
        return "-"
    if not theirs:
        return "lossless"
    if (delta := bd_delta(theirs, ours)) is not None:
        psnr = "" if delta.bd_psnr is None else f" / {delta.bd_psnr:+.1f} dB"
        return f"{delta.bd_rate:+.0f} %{psnr}"
    rates = [(rate, rate_at(ours, psnr)) for rate, psnr in theirs]
    ratios = [mine / rate for rate, mine in rates if mine is not None]
    if ratios:
        return f"{100 * (float(np.exp(np.mean(np.log(ratios)))) - 1):+.0f} % *"
    best, top = max(p for _, p in theirs), max(p for _, p in ours)
    return (
        f"no overlap ({best:.1f} dB against our {top:.1f})" if best > top else f"no overlap ({best:.1f} dB)"
    )


def labels(scenes: dict[str, Any]) -> list[str]:
    """The baselines' curves, in the order in which they occur."""
    found: dict[str, None] = {}
    for scene in scenes.values():
        found |= dict.fromkeys(curves(scene["points"]))
    return [label for label in found if not label.startswith("dfcgs")]


def bd_table() -> str:
    """Every baseline on every scene."""
    scenes = compared_scenes()
    found = labels(scenes)
    rows = [[name, *(against(scene, label) for label in found)] for name, scene in scenes.items()]
    return table(["scene", *found], rows)


def refusal_table() -> str:
    """Why a method has no figure on a scene."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for name, scene in compared_scenes().items():
        for row in scene["points"]:
            if "bytes" not in row:
                reason = row.get("skipped") or row.get("failed")
                scenes = reasons.setdefault((row["label"], reason), [])
                scenes += [name] if name not in scenes else []
    rows = [[label, reason, ", ".join(scenes)] for (label, reason), scenes in reasons.items()]
    return table(["method", "reason", "scenes"], rows)


def _preset_cell(row: dict[str, Any] | None) -> str:
    if row is None:
        return "-"
    return f"{row['bytes_per_frame'] / 1000:.0f} kB, {decibel(row['psnr'])} dB, {row['ssim']:.4f}"


def preset_table() -> str:
    """Bytes and quality of the presets on every scene."""
    rows = []
    for name, scene in compared_scenes().items():
        found = {r["preset"]: r for r in measured(scene["points"]) if r["preset"]}
        rows.append([name, *(_preset_cell(found.get(preset)) for preset in _PRESETS)])
    return table(["scene", *(f"`{p}`" for p in _PRESETS)], rows)


def speed_table() -> str:
    """Median seconds per frame and 100 k Gaussians, and the largest memory, by method."""
    return _by_kind(_speeds)


def _speeds(scenes: dict[str, Any]) -> str:
    found: dict[str, list[list[float]]] = {}
    for scene in scenes.values():
        scale = 1e5 / scene["facts"]["num_gaussians"]
        for row in measured(scene["points"]):
            found.setdefault(row["label"], []).append(
                [
                    row["encode_s_per_frame"] * scale,
                    row["decode_s_per_frame"] * scale,
                    row["encode_peak_mib"],
                    row["decode_peak_mib"],
                ]
            )
    rows = []
    for label, values in found.items():
        times, peaks = np.median(values, axis=0)[:2], np.max(values, axis=0)[2:]
        rows.append([label, f"{times[0]:.2f}", f"{times[1]:.2f}", f"{peaks[0]:.0f}", f"{peaks[1]:.0f}"])
    return table(["method", "encode, s", "decode, s", "encode, MiB", "decode, MiB"], rows)


def differences(scenes: dict[str, Any], label: str, ours: str) -> tuple[int, list[float]]:
    """Scenes that a baseline codes, and logarithms of our bytes relative to its at equal PSNR."""
    logs, scene_count = [], 0
    for scene in scenes.values():
        found = curves(scene["points"])
        if not found.get(label):
            continue
        scene_count += 1
        if (delta := bd_delta(found[label], found.get(ours, []))) is not None:
            logs.append(math.log1p(delta.bd_rate / 100))
            continue
        rates = [(rate, rate_at(found.get(ours, []), psnr)) for rate, psnr in found[label]]
        logs += [math.log(mine / rate) for rate, mine in rates if mine is not None]
    return scene_count, logs


def percent(logarithm: float) -> str:
    """exp(`logarithm`) - 1 in percent."""
    return f"{100 * math.expm1(logarithm):+.0f} %"


def averages() -> str:
    """One line per baseline: mean difference over scenes, best and worst scene; of captures apart."""
    return _by_kind(_averages)


def _averages(scenes: dict[str, Any]) -> str:
    rows = []
    for label in labels(scenes):
        if not any(curves(scene["points"]).get(label) for scene in scenes.values()):
            rows.append([label, str(len(scenes)), *["lossless"] * 4])
            continue
        scene_count, logs = differences(scenes, label, OURS)
        _, short_logs = differences(scenes, label, _SHORT)
        if not logs:
            rows.append([label, str(scene_count), *["no overlap"] * 4])
            continue
        cells = [percent(float(np.mean(logs))), percent(min(logs)), percent(max(logs))]
        cells.append(percent(float(np.mean(short_logs))) if short_logs else "-")
        rows.append([label, str(scene_count), *cells])
    head = [
        "against",
        "scenes",
        "default, mean",
        "best scene",
        "worst scene",
        "`--gof-size 10`, mean",
    ]
    return table(head, rows)
