"""Points and curves in results of the comparison, for charts and tables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from lab.scenes.catalogue import is_capture

#: a PSNR that stands for equal images: nothing lossy comes near
LOSSLESS_PSNR = 120.0
Row = dict[str, Any]


def kinds(scenes: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The scenes of each kind that there are, "objects" before "captures": averages are over one kind."""
    found: dict[str, dict[str, Any]] = {"objects": {}, "captures": {}}
    for name, scene in scenes.items():
        found["captures" if is_capture(name) else "objects"][name] = scene
    return {kind: members for kind, members in found.items() if members}


def measured(rows: Iterable[Row]) -> list[Row]:
    """The points that gave a file."""
    return [row for row in rows if "bytes" in row]


def curve(rows: Iterable[Row], method: str) -> list[tuple[float, float]]:
    """(bytes per frame, PSNR) of a method on a scene; lossless ones have none."""
    return [
        (row["bytes_per_frame"], row["psnr"])
        for row in measured(rows)
        if row["method"] == method and row["psnr"] is not None
    ]


def families(method_rows: list[Row]) -> dict[str, list[Row]]:
    """The rows of one method by curve: settings that differ in their GoF are curves of their own."""
    found: dict[str, list[Row]] = {}
    for row in method_rows:
        _, mark, gof = row["setting"].partition("_gof")
        found.setdefault(f"{row['label']}, GoF {gof}" if mark else row["label"], []).append(row)
    return found


def curves(rows: Iterable[Row]) -> dict[str, list[tuple[float, float]]]:
    """(bytes per frame, PSNR) of every curve of a scene by its label, in the order of the results."""
    labelled = families(measured(rows))
    return {
        label: [(r["bytes_per_frame"], r["psnr"]) for r in members if r["psnr"] is not None]
        for label, members in labelled.items()
    }
