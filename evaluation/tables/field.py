"""The tables of `docs/field.md`: all systems of the paper's tables, and ours.

The paper's numbers, as printed, from `evaluation/paper_field.json`; ours from `evaluation/results/*.json`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evaluation.curves import Row, measured
from evaluation.tables.markdown import table
from lab.record import has_results, results

_NUMBERS = Path(__file__).with_name("paper_field.json")
_CAPTURES = "captures"
_METHOD = "dfcgs"
#: of our presets the one that stands among other systems
_PRESET = "medium"
_PRESETS = ("low", _PRESET, "high", "transparent")
_NOT_YET = "not measured yet"
#: the paper's (K, M, L) -> our setting of the same in `paper_ablations.json`
_SETTINGS = {
    ("30", "70", "300"): "default",
    ("60", "70", "300"): "K = 60",
    ("120", "70", "300"): "K = 120",
    ("30", "140", "300"): "M = 140",
    ("30", "280", "300"): "M = 280",
    ("30", "70", "32"): "L = 32",
    ("30", "70", "4"): "L = 4",
}


def paper(name: str) -> dict[str, Any]:
    """A table of the paper: its label, what it is about, names of columns, and rows."""
    found: dict[str, Any] = json.loads(_NUMBERS.read_text())["tables"][name]
    return found


def captures() -> Iterator[tuple[str, Row]]:
    """Scene and figures of every preset on every capture; none before they are measured."""
    if not has_results(_CAPTURES):
        return
    for scene, found in results(_CAPTURES).items():
        for row in measured(found["points"]):
            if row["method"] == _METHOD and row["setting"] in _PRESETS:
                yield scene, row


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _megabytes(row: Row) -> str:
    return f"{row['bytes_per_frame'] / 1e6:.3f}"


def _ours(width: int) -> list[list[str]]:
    """Our rows of a table of systems, by the paper's own measure."""
    rows = [
        [
            f"**this codec**, `{scene}`, `{row['setting']}`",
            "codec of Gaussians",
            _number(row["psnr_true_decoded"], 2),
            _number(row["ssim_true_decoded"], 3),
            _megabytes(row),
            f"decodes {1 / row['decode_s_per_frame']:.1f}",
            "yes",
        ][:width]
        for scene, row in captures()
        if row["setting"] == _PRESET
    ]
    missing = ["**this codec** on the fitted captures", "codec of Gaussians", _NOT_YET, "", "", "", "yes"]
    return rows or [missing[:width]]


def _systems(name: str, head: list[str]) -> str:
    found = paper(name)
    columns = ["method", "kind", *found["columns"]]
    rows = [["-" if row[c] is None else row[c] for c in columns] for row in found["rows"]]
    return table(head, [*rows, *_ours(len(head))])


_HEAD = ["system", "what it is", "PSNR, dB", "SSIM", "MB a frame", "frames per second"]


def n3v_table() -> str:
    """All systems on N3V."""
    return _systems("n3v", [*_HEAD, "compresses without training for the scene"])


def meetroom_table() -> str:
    """All systems on MeetRoom."""
    return _systems("meetroom", _HEAD)


def captures_table() -> str:
    """Our presets on captures, by the paper's measure and beside what they were given."""
    rows = [
        [
            scene,
            f"`{row['setting']}`",
            _number(row["psnr_true_decoded"], 2),
            _number(row["psnr_true_input"], 2),
            _number(row["psnr_full_frame"], 2),
            _number(row["ssim_true_decoded"], 4),
            _megabytes(row),
            f"{row['encode_s_per_frame']:.2f} / {row['decode_s_per_frame']:.2f}",
        ]
        for scene, row in captures()
    ]
    head = ["capture", "preset", "PSNR against the truth, dB", "of the input, dB", "against the input, dB"]
    head += ["SSIM against the truth", "MB a frame", "encode / decode, s per frame"]
    return table(head, rows or [[_NOT_YET, *[""] * (len(head) - 1)]])


def robustness_table() -> str:
    """Other datasets."""
    rows = [
        [row["dataset"], row["method"], row["psnr"], row["ssim"], row["mb"]]
        for row in sorted(paper("robustness")["rows"], key=lambda row: row["dataset"])
    ]
    return table(["dataset", "system", "PSNR, dB", "SSIM", "MB, P-frame"], rows)


def hyperparameters_table() -> str:
    """K, M and L, and the same of profile `paper` on our scenes."""
    scenes = results("paper_ablations")
    rows = []
    for row in paper("hyperparameters")["rows"]:
        setting = (row["k"], row["m"], row["l"])
        ours = [scene[_SETTINGS[setting]] for scene in scenes.values()]
        cells = [f"{own['bytes_per_p'] / 1000:.2f} kB, {own['psnr']:.2f} dB" for own in ours]
        rows.append([*setting, f"{row['tenths_of_mb']} x 0.1 MB, {row['psnr']} dB", *cells])
    return table(["K", "M", "L", "paper, cut_beef", *(f"profile `paper`, {name}" for name in scenes)], rows)


def _seconds(what: str, encode: float, decode: float) -> list[str]:
    return [what, f"{encode:.2f}", f"{decode:.2f}", f"{encode + decode:.2f}"]


def time_table() -> str:
    """Seconds of a P-frame."""
    names = ("D-FCGS, {}, RTX 4090", "profile `paper`, {}, {}, two CPU cores")
    rows = [
        [names[0].format(row["method"]), row["encode_s"], row["decode_s"], row["total_s"]]
        for row in paper("time")["rows"]
    ]
    for scene, found in results("paper_ablations").items():
        for setting in ("control points", "no control points"):
            if setting in found:
                own = found[setting]
                what = names[1].format(setting, scene)
                rows.append(_seconds(what, own["encode_s_per_frame"], own["decode_s_per_frame"]))
    for scene in ("tracked", "character_200k"):
        own = results("speed")[scene]
        what = f"profile `main`, {own['num_gaussians'] // 1000} k Gaussians (`{scene}`), one CPU core"
        rows.append(_seconds(what, own["encode_p_s"], own["decode_p_s"]))
    return table(["what", "encode, s", "decode, s", "total, s"], rows)
