"""Tables of the profile `paper` for `docs/results.md`."""

from __future__ import annotations

from typing import Any

from evaluation.tables.markdown import table
from lab.record import results

#: columns of the first table: setting -> head
_CURVES = {
    "paper, q' = 0.5": "q' = 0.5",
    "paper, q' = 1": "q' = 1",
    "paper, q' = 2": "q' = 2",
    "paper, q' = 4": "q' = 4",
    "paper, refined": "refined",
    "paper's rule, no network": "its rule, no network",
    "main, no residual": "main, no residual",
    "main, qp34": "main, QP 34",
    "main": "main, QP 28",
    "main, qp18": "main, QP 18",
}
_WHOLE = ("paper, ply I-frames", "paper, q' = 1", "main")
_NETWORK = [name for name in _CURVES if name.startswith("paper, q'")]

Row = dict[str, Any]


def _point(row: Row) -> str:
    if set(row["frame_types"]) == {"I"}:
        return "I-frames only"
    quality = "equal" if row["psnr"] is None else f"{row['psnr']:.1f} dB"
    return f"{row['bytes_p'] / 1000:.1f} kB, {quality}"


def curves_table() -> str:
    """P-frames of one GoF, by setting; all begin with the same I-frame but where another QP is named."""
    rows = []
    for name, scene in results("paper_profile").items():
        settings = scene["settings"]
        gains = [settings[key]["least_gain"] for key in _NETWORK]
        rows.append([name, *(_point(settings[key]) for key in _CURVES), f"{min(gains):+.2f} dB"])
    return table(["scene", *_CURVES.values(), "over the frame before, worst frame"], rows)


def whole_table() -> str:
    """Whole files, and seconds."""
    rows = []
    for name, scene in results("paper_profile").items():
        found = [scene["settings"][key] for key in _WHOLE]
        seconds = [f"{row['encode_s_per_frame']:.2f} / {row['decode_s_per_frame']:.2f}" for row in found[1:]]
        rows.append(
            [name, str(scene["num_gaussians"]), *(f"{row['bytes'] / 1000:.0f}" for row in found), *seconds]
        )
    head = ["scene", "N", "paper, ply I-frames, kB", "paper, kB", "main, kB"]
    return table([*head, "paper, encode / decode, s per frame", "main, encode / decode"], rows)


def ablation_table() -> str:
    """Every setting on every scene: bytes of a P-frame and PSNR, and seconds per frame."""
    found = results("paper_ablations")
    settings = list(dict.fromkeys(name for scene in found.values() for name in scene))
    rows = []
    for setting in settings:
        cells = []
        for scene in found.values():
            row = scene.get(setting)
            if row is None:
                cells.append("-")
                continue
            times = f"{row['encode_s_per_frame']:.2f} / {row['decode_s_per_frame']:.2f} s"
            cells.append(f"{row['bytes_per_p']:.0f} B, {row['psnr']:.2f} dB, {times}")
        rows.append([setting, *cells])
    return table(["setting", *found], rows)
