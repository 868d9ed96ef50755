"""Tables of captures and of promises."""

from __future__ import annotations

from typing import Any

import pytest

from evaluation.tables import captures as capture_tables
from lab.scenes.catalogue import group

CAPTURE = group("captures")[0].name


def given(monkeypatch: pytest.MonkeyPatch, found: dict[str, Any]) -> None:
    monkeypatch.setattr(capture_tables, "results", lambda _: found)


def test_ratios_are_averaged_geometrically(monkeypatch: pytest.MonkeyPatch) -> None:
    def beside(ratio: float) -> dict[str, Any]:
        return {"against": {"ours": {"uniform": {"bytes_ratio": ratio}}}}

    given(monkeypatch, {"a": beside(0.2), "b": beside(0.8), "c": {"against": {}}})
    assert capture_tables.bytes_table().splitlines()[-1] == "| ours | uniform | 0.20 | 0.80 | - | 0.40 |"


def test_presets_stand_beside_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    row = {
        "method": "dfcgs_views",
        "setting": "high",
        "bytes": 9,
        "bytes_per_frame": 12_340.0,
        "psnr": 42.04,
        "psnr_worst_frame": 41.5,
        "psnr_true_decoded": 35.25,
        "psnr_true_input": 36.0,
        "ssim_true_decoded": 0.98,
        "ssim_true_input": 0.99,
    }
    more = [row | {"method": "dfcgs", "setting": "qp40"}, row | {"method": "delta_zstd"}]
    given(monkeypatch, {"a": {"points": [row, *more]}})
    assert capture_tables.truth_table().splitlines()[2:] == [
        "| a | `high`, told its cameras | 12.3 | 42.0 | 41.5 | 35.2 (36.0) | 0.9800 (0.9900) |"
    ]


def test_promises_are_summed_up_by_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    def row(psnr: float, expected: float | None) -> dict[str, Any]:
        return {"high": {"psnr": psnr, "worst_minus_mean": -0.5, "estimated_psnr": expected}}

    given(monkeypatch, {CAPTURE: row(40.0, None), "a": row(43.0, 42.0), "b": row(44.0, 44.5), "c": {}})
    assert capture_tables.promise_table().splitlines()[2:] == [
        "| a | 43.0 dB, worst -0.5, expected -1.0 |",
        "| b | 44.0 dB, worst -0.5, expected +0.5 |",
        "| c | - |",
        "| **objects** | 43.0 dB at least, off by 0.8, 1.0 at most |",
        f"| {CAPTURE} | 40.0 dB, worst -0.5 |",
        "| **captures** | 40.0 dB at least |",
    ]
