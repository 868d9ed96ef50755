from __future__ import annotations

import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("numba")

from evaluation.experiments.long_smooth import points, ratios
from evaluation.tables import motion


def rows(label: str, setting: str, scale: float) -> list[dict[str, object]]:
    return [
        {
            "method": label,
            "label": label,
            "setting": setting,
            "bytes": 1,
            "bytes_per_frame": scale * 1000 / 2**index,
            "psnr": 42.0 - 6 * index,
        }
        for index in range(3)
    ]


def test_bytes_are_compared_at_equal_psnr() -> None:
    found = ratios([*rows("dfcgs (default)", "qp", 1), *rows("delta", "qp_gof10", 4)])
    assert found == {"delta, GoF 10": pytest.approx(0.25, abs=1e-3)}


def test_both_methods_are_swept_at_both_gof_sizes() -> None:
    settings = {point.setting for point in points()}
    assert {"low", "medium", "high"} <= settings
    assert sum(setting.endswith("_gof10") for setting in settings) >= 3
    assert sum(setting.endswith("_gof60") for setting in settings) >= 3


def test_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "results", lambda _: {"a": {"ratios": {"delta, GoF 10": 0.254}}})
    assert motion.long_smooth_table().splitlines()[2] == "| a | 0.25 |"
