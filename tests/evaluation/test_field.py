"""The page of the paper's field: its numbers are whole, and it is what they and the results make."""

from __future__ import annotations

import json
from typing import Any

import pytest

pytest.importorskip("numba")
pytest.importorskip("bjontegaard")

from evaluation.tables import field, pages
from lab.record import REPOSITORY, results

#: table -> rows, and the keys of each beside the system's name
SHAPES = {
    "n3v": (12, {"kind", "psnr", "ssim", "mb", "fps", "feedforward"}),
    "meetroom": (7, {"kind", "psnr", "ssim", "mb", "fps"}),
    "robustness": (6, {"dataset", "psnr", "ssim", "mb"}),
    "hyperparameters": (7, {"k", "m", "l", "tenths_of_mb", "psnr"}),
    "time": (2, {"encode_s", "decode_s", "total_s"}),
}
WORDS = {"method", "kind", "dataset", "feedforward"}
FIGURES = {
    "psnr_true_input": 31.25,
    "psnr_true_decoded": 30.5,
    "psnr_full_frame": 41.0,
    "ssim_true_decoded": 0.94321,
    "bytes": 2_000_000,
    "bytes_per_frame": 100_000.0,
    "encode_s_per_frame": 1.5,
    "decode_s_per_frame": 0.25,
}


def test_the_file_has_all_tables() -> None:
    assert set(json.loads(field._NUMBERS.read_text())["tables"]) == set(SHAPES)


@pytest.mark.parametrize("name", SHAPES)
def test_rows_are_whole(name: str) -> None:
    found = field.paper(name)
    count, keys = SHAPES[name]
    assert found["label"].startswith("tab:")
    assert found["about"]
    assert set(found["columns"]) == keys - {"kind"}
    assert len(found["rows"]) == count
    for row in found["rows"]:
        assert set(row) == {"method", *keys}
        for key in keys - WORDS:
            # a dash is printed for one SSIM alone
            assert (row[key] is None) == (row["method"] == "HiCoM" and key == "ssim")
            assert row[key] is None or float(row[key]) > 0
    assert len({tuple(row.values()) for row in found["rows"]}) == count


def test_figures_are_in_their_columns() -> None:
    for name in ("n3v", "meetroom", "robustness"):
        for row in field.paper(name)["rows"]:
            assert 25 <= float(row["psnr"]) <= 33
            assert row["ssim"] is None or 0.85 <= float(row["ssim"]) <= 0.96
            assert 0.3 <= float(row["mb"]) <= 20
    for row in field.paper("time")["rows"]:
        assert float(row["encode_s"]) + float(row["decode_s"]) == pytest.approx(float(row["total_s"]))


def test_both_tables_of_systems_agree_on_what_they_are() -> None:
    kinds = {row["method"]: row["kind"] for row in field.paper("n3v")["rows"]}
    for row in field.paper("meetroom")["rows"]:
        assert row["kind"] == kinds[row["method"]]


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]


def test_every_row_is_as_wide_as_its_head() -> None:
    text = (REPOSITORY / "docs" / "field.md").read_text()
    for name in pages.marks(text):
        assert len({len(row) for row in cells(pages.TABLES[name][1]())}) == 1


def test_without_captures_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field, "has_results", lambda name: False)
    for made in (field.n3v_table, field.meetroom_table):
        assert cells(made())[-1][:3] == [
            "**this codec** on the fitted captures",
            "codec of Gaussians",
            "not measured yet",
        ]
    assert cells(field.captures_table())[2][0] == "not measured yet"


def point(method: str, setting: str, **figures: Any) -> dict[str, Any]:
    return {"method": method, "label": method, "setting": setting} | FIGURES | figures


def test_with_captures_our_rows_stand_last(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        point("dfcgs", "medium"),
        point("dfcgs", "high", bytes_per_frame=300_000.0, psnr_full_frame=None),
        point("dfcgs", "qp24"),
        point("delta_zstd", "medium"),
        {"method": "dfcgs", "label": "dfcgs", "setting": "low", "refused": "for a test"},
    ]
    monkeypatch.setattr(field, "has_results", lambda name: True)
    monkeypatch.setattr(
        field, "results", lambda name: {"a": {"points": points}} if name == "captures" else results(name)
    )
    ours = ["**this codec**, `a`, `medium`", "codec of Gaussians", "30.50", "0.943", "0.100", "decodes 4.0"]
    assert cells(field.n3v_table())[-1] == [*ours, "yes"]
    assert cells(field.meetroom_table())[-1] == ours
    assert len(cells(field.meetroom_table())) == 2 + 7 + 1
    assert cells(field.captures_table())[2:] == [
        ["a", "`medium`", "30.50", "31.25", "41.00", "0.9432", "0.100", "1.50 / 0.25"],
        ["a", "`high`", "30.50", "31.25", "-", "0.9432", "0.300", "1.50 / 0.25"],
    ]
