"""Tables of I-frames, and of the proportions of quantiser steps."""

from __future__ import annotations

from typing import Any

from evaluation.experiments.i_frames.intra import CURVES
from evaluation.experiments.i_frames.surroundings import VARIANTS
from evaluation.tables.markdown import table
from lab.record import results

_OTHERS = ("spz", "sog")


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _others(scene: dict[str, Any]) -> list[str]:
    cells = []
    for name in _OTHERS:
        other = scene["others"].get(name, {})
        if "psnr" not in other:
            cells += ["-", "-"]
            continue
        cells.append(f"{other['bits_per_gaussian']:.0f} bits, {other['psnr']:.1f} dB")
        cells.append(" / ".join(_ratio(other["vs"][curve]) for curve in CURVES))
    return cells


def ratio_table() -> str:
    """Bits of an I-frame against other methods and against ourselves without grading."""
    rows = []
    for name, scene in results("intra").items():
        bits = [scene["bits_at_40_db"][curve] for curve in CURVES]
        cells = [name, str(scene["num_gaussians"]), str(scene["sh_degree"]), *_others(scene)]
        cells.append(" / ".join("-" if b is None else f"{b:.0f}" for b in bits))
        delta = scene["bd_rate_to_uniform"]["graded"]
        rows.append([*cells, "-" if delta is None else f"{delta:+.1f} %"])
    head = [
        "splat",
        "N",
        "SH",
        "SPZ",
        "ours / SPZ",
        "SOG",
        "ours / SOG",
        "bits at 40 dB",
        "BD-rate to uniform",
    ]
    return table(head, rows)


def lossless_table() -> str:
    """`--quality lossless` against general compressors."""
    rows = []
    for name, scene in results("intra").items():
        sizes = scene["lossless"]
        cells = [f"{sizes['ply'] / sizes[method]:.2f}" for method in ("dfcgs", "xz", "zstd")]
        rows.append([name, str(sizes["ply"]), *cells])
    return table(["splat", "PLY, bytes", "`--quality lossless`", "xz -9", "zstd -22"], rows)


def quantised_table() -> str:
    """Inputs that SPZ has quantised: kept exactly, against coded anew at the same PSNR."""
    rows = []
    for name, scene in results("quantised_input").items():
        for point in scene["auto"]:
            if not point["is_kept"]:
                continue
            bits = f"{point['bytes'] / scene['spz_bytes']:.2f}"
            saved = "beyond its reach" if point["ratio"] is None else f"{100 * (point['ratio'] - 1):+.0f} %"
            rows.append([name, f"{point['qp']:g}", f"{point['psnr']:.1f} dB", bits, saved])
    return table(["splat, from SPZ", "QP", "PSNR", "bytes / SPZ", "against `exact=False`"], rows)


def surroundings_table() -> str:
    """An object alone and in surroundings: the default, and what leaving parts of the encoder out costs."""
    medium, others = 28, [variant for variant in VARIANTS if variant != "default"]
    rows = []
    for name, splat in results("surroundings").items():
        for where, found in splat.items():
            (point,) = (p for p in found["default"]["points"] if p["qp"] == medium)
            rates = [found[variant]["bd_rate"] for variant in others]
            cells = [name, where, str(found["num_gaussians"])]
            cells.append(f"{point['bytes'] / 1000:.0f} kB, {point['psnr']:.1f} dB")
            rows.append([*cells, *("-" if rate is None else f"{rate:+.1f} %" for rate in rates)])
    head = ["splat", "where", "N", f"default, QP {medium}", *(f"{v}, BD-rate" for v in others)]
    return table(head, rows)


def allocation_table() -> str:
    """What the codec's proportions of steps cost above the best ones."""
    found = results("allocation")
    targets = list(next(iter(found.values()))["targets"])
    rows = [
        [name, scene["group"], *(f"{100 * scene['targets'][t]['excess']:.1f} %" for t in targets)]
        for name, scene in found.items()
    ]
    return table(["scene", "group", *(f"{-float(t):.0f} dB" for t in targets)], rows)
