"""Tables of what motion is worth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evaluation.bd import bd_delta
from evaluation.curves import curves, kinds
from evaluation.tables.comparison import OURS, STILL, compared_scenes
from evaluation.tables.markdown import table
from lab.record import results


def _inter_curve(scene: dict[str, Any], method: str) -> list[tuple[float, float]]:
    """Bytes of P-frames and PSNR of one of our curves."""
    rows = [row for row in scene["points"] if row["method"] == method and "bytes_by_frame_type" in row]
    return [(float(row["bytes"] - row["bytes_by_frame_type"]["I"]), row["psnr"]) for row in rows]


def _mean_rate(rates: list[float]) -> str:
    """Geometric mean of BD-rates in percent."""
    return f"{100 * math.expm1(float(np.mean(np.log1p(np.array(rates) / 100)))):+.1f} %"


def _control_points(scene: dict[str, Any]) -> str:
    """Control points with symbols in the P-frames of `medium`: least, median, most."""
    for row in scene["points"]:
        if row["method"] == "dfcgs" and row["setting"] == "medium" and "control_points" in row:
            kinds = zip(row["control_points"], row["frame_types"], strict=True)
            found = [count for count, kind in kinds if kind == "P"]
            return f"{min(found)} / {int(np.median(found))} / {max(found)}" if found else "-"
    return "-"


def motion_table() -> str:
    """What motion saves: bytes at equal PSNR against the same without it."""
    parts = [(kind, *_motion_rows(scenes)) for kind, scenes in kinds(compared_scenes()).items()]
    many = sum(bool(files) for _, _, files, _ in parts) > 1
    rows = []
    for kind, found, files, inters in parts:
        rows += found
        if files:
            name = f"mean of {kind}" if many else "mean"
            rows.append([name, _mean_rate(files), "", _mean_rate(inters) if inters else "", ""])
    head = [
        "scene",
        "whole file, bytes at equal PSNR",
        "PSNR at equal bytes",
        "P-frames, bytes at equal PSNR",
    ]
    return table([*head, "control points"], rows)


def _motion_rows(scenes: dict[str, Any]) -> tuple[list[list[str]], list[float], list[float]]:
    """Rows of scenes, and their BD-rates of files and of P-frames."""
    rows, files, inters = [], [], []
    for name, scene in scenes.items():
        found = curves(scene["points"])
        delta = bd_delta(found.get(STILL, []), found.get(OURS, []))
        if delta is None:
            continue
        inter = bd_delta(_inter_curve(scene, "dfcgs_still"), _inter_curve(scene, "dfcgs"))
        psnr = "" if delta.bd_psnr is None else f"{delta.bd_psnr:+.2f} dB"
        files.append(delta.bd_rate)
        if inter is not None:
            inters.append(inter.bd_rate)
        shown = "-" if inter is None else f"{inter.bd_rate:+.1f} %"
        rows.append([name, f"{delta.bd_rate:+.1f} %", psnr, shown, _control_points(scene)])
    return rows, files, inters


def _ablation_cell(inter: float | None, file: float | None) -> str:
    shown = ["-" if rate is None else f"{rate:+.1f}" for rate in (inter, file)]
    return "no overlap" if inter is None and file is None else f"{' / '.join(shown)} %"


def _mean_where_all(found: dict[str, Any], variant: str, key: str) -> str:
    """Mean of a variant over the scenes on which the default has a figure; none if it lacks one of them."""
    rates = [scene.get(variant, {}).get(key) for scene in found.values() if scene["default"][key] is not None]
    known = [rate for rate in rates if rate is not None]
    return _mean_rate(known).removesuffix(" %") if known and len(known) == len(rates) else "-"


def ablation_table() -> str:
    """Bytes of P-frames and of whole files at equal PSNR of every variant against the default."""
    found = results("motion")
    variants: dict[str, None] = {}
    for scene in found.values():
        variants |= dict.fromkeys(name for name in scene if name != "default")
    rows = []
    for variant in variants:
        scenes = [scene.get(variant, {}) for scene in found.values()]
        cells = [_ablation_cell(row.get("bd_rate_inter"), row.get("bd_rate_file")) for row in scenes]
        means = [_mean_where_all(found, variant, f"bd_rate_{part}") for part in ("inter", "file")]
        rows.append([variant, *cells, "-" if set(means) == {"-"} else f"{' / '.join(means)} %"])
    return table(["variant", *found, "mean"], rows)


def long_smooth_table() -> str:
    """Our bytes as a part of quantised delta + zstd's on smooth scenes of 60 frames."""
    found = results("long_smooth")
    labels = list(dict.fromkeys(label for scene in found.values() for label in scene["ratios"]))
    rows = [
        [name, *(f"{scene['ratios'][label]:.2f}" if label in scene["ratios"] else "-" for label in labels)]
        for name, scene in found.items()
    ]
    return table(["scene", *labels], rows)


def compensation_table() -> str:
    """Motion without residual: both rules, and the last frame repeated."""
    rows = []
    for name, scene in results("compensation").items():
        for qp, settings in scene.items():
            if not qp.startswith("qp"):
                continue
            for setting, row in settings.items():
                if setting == "against":
                    continue
                least = settings["against"].get(setting, {}).get("least_gain")
                rows.append(
                    [
                        f"{name}, QP {qp[2:]}",
                        setting.replace("_", " "),
                        "-" if "bytes_p" not in row else f"{row['bytes_p'] / 1000:.1f}",
                        f"{row['psnr']:.2f}",
                        "" if least is None else f"{least:+.1f}",
                    ]
                )
    head = ["scene", "rule", "P-frames, kB", "PSNR, dB"]
    return table([*head, "main is better by, dB, worst frame"], rows)
