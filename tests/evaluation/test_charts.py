"""Charts and tables from results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("bjontegaard")

from evaluation.charts import __main__ as charts
from evaluation.charts import bytes_chart, drift, rate_distortion, speed, style
from evaluation.charts.speed import pareto_front
from evaluation.curves import curves
from evaluation.tables import comparison, markdown, motion, pages, summary
from lab import record
from lab.scenes.catalogue import group

PRESETS = {"low": 30.0, "medium": 36.0, "high": 43.0, "transparent": 52.0}


def row(
    method: str, label: str, setting: str, rate: float, psnr: float | None, **more: Any
) -> dict[str, Any]:
    return {
        "method": method,
        "label": label,
        "setting": setting,
        "preset": None,
        "bytes": 10 * rate,
        "bytes_per_frame": rate,
        "bits_per_gaussian": rate / 100,
        "psnr": psnr,
        "ssim": 0.99,
        "encode_s_per_frame": 0.5,
        "decode_s_per_frame": 0.1,
        "encode_peak_mib": 100.0,
        "decode_peak_mib": 50.0,
        **more,
    }


def scene(scale: float = 1.0) -> dict[str, Any]:
    """Ours doubles its bytes every 6 dB; `delta` takes twice, `spz` one large point, `raw` is lossless."""
    ours = [
        row(
            "dfcgs",
            "dfcgs (default)",
            name,
            scale * 1000 * 2 ** (psnr / 6),
            psnr,
            preset=name,
            bytes_by_attribute={"POSITION": 10, "SH_DC": 5},
            bytes_by_frame_type={"I": 6, "P": 9},
            frame_types="IP",
        )
        for name, psnr in PRESETS.items()
    ]
    delta = [
        row("delta_zstd", "delta", f"qp{qp}_gof{gof}", scale * (2 - gof / 100) * 1000 * 2 ** (psnr / 6), psnr)
        for gof in (10, 60)
        for qp, psnr in ((16, 50.0), (22, 40.0), (28, 33.0))
    ]
    still = [
        row("dfcgs_still", "dfcgs, no motion", name, 2 * point["bytes_per_frame"], point["psnr"])
        for name, point in zip(PRESETS, ours, strict=True)
    ]
    others = [
        *still,
        row("spz", "SPZ", "v4", scale * 1000 * 2 ** (45 / 6) * 4, 45.0),
        row("raw_zstd", "raw", "19", 1e9, None),
        {
            "method": "splats4d",
            "label": "splats4d",
            "setting": "default",
            "preset": None,
            "skipped": "drops SH",
        },
    ]
    facts = {"num_gaussians": 50_000, "num_frames": 20, "sh_degree": 1}
    return {"facts": facts, "points": [*ours, *delta, *others]}


CAPTURE = group("captures")[0].name
SCENES = {name: scene(scale) for name, scale in (("a", 1.0), ("b", 3.0), ("c", 0.5))}


def test_settings_that_differ_in_their_gof_are_curves_of_their_own() -> None:
    assert list(curves(scene()["points"])) == [
        "dfcgs (default)",
        "delta, GoF 10",
        "delta, GoF 60",
        "dfcgs, no motion",
        "SPZ",
        "raw",
    ]


def test_average_rates_do_not_depend_on_a_scene_s_size() -> None:
    relative = rate_distortion.relative_rates(SCENES)
    at_42 = next(p for p in relative["dfcgs (default)"] if p[1] == 42.0)
    assert at_42 == (pytest.approx(1.0), 42.0, 3)
    for rate, psnr, _ in relative["delta, GoF 10"]:
        assert rate == pytest.approx(1.9 * 2 ** ((psnr - 42) / 6), rel=1e-6)
    assert "SPZ" not in relative


def test_speed_points() -> None:
    points = speed.averaged(SCENES)
    assert points["delta, GoF 10"]["relative_rate"] == 1.0
    assert points["delta, GoF 10"]["psnr"] < points["dfcgs (default)"]["psnr"] == pytest.approx(43.0)
    assert points["SPZ"]["relative_rate"] == pytest.approx(4 * 2 ** (2 / 6))
    assert points["SPZ"]["encode"] == pytest.approx(1.0)
    assert points["transparent"]["psnr"] == 52.0


def test_pareto_front_takes_nothing_bought_with_bytes() -> None:
    def point(seconds: float, psnr: float, rate: float = 1.0) -> dict[str, float]:
        return {"encode": seconds, "psnr": psnr, "relative_rate": rate}

    points = {"slow": point(9, 44), "fast": point(1, 30), "beaten": point(2, 29), "large": point(3, 50, 4.0)}
    assert pareto_front(points, "encode") == ["fast", "slow"]


def test_all_charts_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "CHARTS", tmp_path)
    rate_distortion.per_scene(SCENES)
    rate_distortion.averaged(SCENES)
    speed.chart(SCENES)
    bytes_chart.chart(SCENES)
    series = {"bytes": 5, "psnr": [40.0] * 20}
    names = [f"gof{n}" for n in (4, 10, 32, 60, 300)]
    drift.chart({"long": {"intra": series, **dict.fromkeys(names, series)}})
    for name in (
        "rate_distortion",
        "rate_distortion_average",
        "speed_accuracy",
        "where_the_bytes_go",
        "drift",
    ):
        assert (tmp_path / f"{name}.svg").read_text().lstrip().startswith("<?xml")
        json.loads((tmp_path / f"{name}.json").read_text())


def test_the_same_figures_give_the_same_chart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    for name in ("first", "second"):
        monkeypatch.setattr(style, "CHARTS", tmp_path / name)
        rate_distortion.averaged(SCENES)
        drawn.append((tmp_path / name / "rate_distortion_average.svg").read_bytes())
    assert drawn[0] == drawn[1]


def keep(folder: Path, monkeypatch: pytest.MonkeyPatch, **results: Any) -> None:
    """These results, and none else, are what was measured."""
    monkeypatch.setattr(record, "RESULTS", folder)
    for name, found in results.items():
        (folder / f"{name}.json").write_text(json.dumps({"results": found}))


def test_captures_have_averages_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the bytes on a capture: averages over objects stay as they are."""
    cheap = scene()
    for point in cheap["points"]:
        if point["method"] == "dfcgs":
            point["bytes_per_frame"] /= 2
    found = {"bench": SCENES, "captures": {CAPTURE: cheap}}
    keep(tmp_path, monkeypatch, **found)
    lines = comparison.averages().splitlines()
    assert lines[0] == "Captures:"
    assert lines[4] == "| delta, GoF 10 | 1 | -74 % | -74 % | -74 % | - |"
    below = lines[lines.index("Objects:") :]
    assert below[4] == "| delta, GoF 10 | 3 | -47 % | -47 % | -47 % | - |"
    means = [line for line in motion.motion_table().splitlines() if "mean" in line]
    assert means == ["| mean of objects | -50.0 % |  |  |  |", "| mean of captures | -75.0 % |  |  |  |"]
    assert comparison.bd_table().splitlines()[-1].startswith(f"| {CAPTURE} |")
    assert comparison.speed_table().count("| SPZ |") == 2
    monkeypatch.setattr(style, "CHARTS", tmp_path)
    charts.main()
    of_objects, of_capture = (
        json.loads((tmp_path / f"rate_distortion_average{suffix}.json").read_text())
        for suffix in ("", "_captures")
    )
    assert {points[2] for points in of_objects["delta, GoF 10"]} == {3}
    at_42 = [
        next(rate for rate, psnr, _ in data["delta, GoF 10"] if psnr == 42.0)
        for data in (of_objects, of_capture)
    ]
    assert at_42 == [pytest.approx(1.9), pytest.approx(3.8)]
    assert (tmp_path / "speed_accuracy_captures.svg").exists()


def test_captures_that_were_not_measured_leave_no_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path, monkeypatch, bench=SCENES)
    assert "captures" not in comparison.averages() + comparison.speed_table() + motion.motion_table()
    partly = scene()
    partly["points"] = [p for p in partly["points"] if p["method"] == "delta_zstd"]
    monkeypatch.setattr(style, "CHARTS", tmp_path)
    speed.chart({CAPTURE: partly}, "_captures")
    assert not list(tmp_path.glob("*.svg"))


@pytest.mark.parametrize(
    ("label", "cell"),
    [("delta, GoF 10", "-47 %"), ("SPZ", "-75 % *"), ("raw", "lossless"), ("never run", "-")],
)
def test_bytes_against_a_baseline(label: str, cell: str) -> None:
    assert comparison.against(scene(), label).startswith(cell)


def test_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path, monkeypatch, bench=SCENES)
    assert comparison.averages().splitlines()[2] == "| delta, GoF 10 | 3 | -47 % | -47 % | -47 % | - |"
    assert "| splats4d | drops SH | a, b, c |" in comparison.refusal_table()
    assert comparison.bd_table().count("\n") == 2 + len(SCENES)
    assert "43.0 dB" in comparison.preset_table()
    assert motion.motion_table().splitlines()[-1] == "| mean | -50.0 % |  |  |  |"
    assert "| SPZ | 1.00 | 0.20 | 100 | 50 |" in comparison.speed_table()


def test_motion_is_compared_by_p_frames_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = []
    for method, label, scale in (("dfcgs", "dfcgs (default)", 1), ("dfcgs_still", "dfcgs, no motion", 4)):
        for index, psnr in enumerate((40.0, 35.0, 30.0)):
            inter = scale * 1000 // 2**index
            rows.append(
                {
                    "method": method,
                    "label": label,
                    "setting": ("high", "medium", "low")[index],
                    "psnr": psnr,
                    "bytes": 5000 // 2**index + inter,
                    "bytes_per_frame": (5000 // 2**index + inter) / 4,
                    "bytes_by_frame_type": {"I": 5000 // 2**index, "P": inter},
                    "frame_types": "IPPP",
                    "control_points": [0, 3, 9, 4],
                }
            )
    keep(tmp_path, monkeypatch, bench={"a": {"points": rows}})
    cells = motion.motion_table().splitlines()[2].split(" | ")
    assert cells[1] == "-33.3 %"
    assert cells[3] == "-75.0 %"
    assert cells[4] == "3 / 4 / 9 |"


def test_table_of_ablations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rates = {"a": (100.0, 21.0), "b": (-50.0, 0.0)}
    found = {
        name: {
            "default": {"bd_rate_inter": 0.0, "bd_rate_file": 0.0},
            "stride": {"bd_rate_inter": inter, "bd_rate_file": file},
            "off": {"bd_rate_inter": None, "bd_rate_file": None},
        }
        for name, (inter, file) in rates.items()
    }
    keep(tmp_path, monkeypatch, motion=found)
    lines = motion.ablation_table().splitlines()
    assert lines[2] == "| stride | +100.0 / +21.0 % | -50.0 / +0.0 % | +0.0 / +10.0 % |"
    assert lines[3] == "| off | no overlap | no overlap | - |"
    found["b"] = {name: {**row, "bd_rate_inter": None} for name, row in found["b"].items()}
    keep(tmp_path, monkeypatch, motion=found)
    lines = motion.ablation_table().splitlines()
    assert lines[2] == "| stride | +100.0 / +21.0 % | - / +0.0 % | +100.0 / +10.0 % |"


def test_table_of_compensation_rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = {
        "main": {"bytes_p": 1500, "psnr": 40.0},
        "paper": {"bytes_p": 5000, "psnr": 20.0},
        "paper_best": {"psnr": 22.5},
        "against": {"paper": {"gain": 20.0, "least_gain": 18.0}},
    }
    keep(tmp_path, monkeypatch, compensation={"a": {"num_gaussians": 9, "qp28": row}})
    lines = motion.compensation_table().splitlines()
    assert lines[2] == "| a, QP 28 | main | 1.5 | 40.00 |  |"
    assert lines[3] == "| a, QP 28 | paper | 5.0 | 20.00 | +18.0 |"
    assert lines[4] == "| a, QP 28 | paper best | - | 22.50 |  |"


def test_summary_keeps_captures_and_objects_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    speed = {"character_200k": {"encode_p_s": 0.5, "decode_p_s": 0.25}}
    memory = {"encode": {"peak_mib": 200.0}, "decode": {"peak_mib": 100.0}}
    told = scene()
    told["points"] += [
        p | {"label": "dfcgs, told its cameras", "bytes_per_frame": p["bytes_per_frame"] / 2}
        for p in told["points"]
        if p["method"] == "dfcgs"
    ]
    keep(tmp_path, monkeypatch, bench=SCENES, captures={CAPTURE: told}, speed=speed, memory=memory)
    text = summary.summary_table()
    lines = text.splitlines()
    assert lines[0] == "| bytes against | captures, `--views` | captures | objects |"
    cells = [f"**{mean}** ({mean} to {mean})" for mean in ("-74 %", "-47 %", "-47 %")]
    assert lines[2] == f"| delta, GoF 10 | {' | '.join(cells)} |"
    assert not any(line.startswith("| raw") for line in lines)
    assert "encodes in 0.50 s and decodes in 0.25 s" in text
    assert "encode in 200 MiB (two processes together) and decode in 100 MiB" in text


def test_tables_go_between_their_marks() -> None:
    text = "a\n<!-- bd -->\nold\n<!-- end of bd -->\nb"
    assert markdown.replace_between(text, "bd", "new\n") == "a\n<!-- bd -->\nnew\n<!-- end of bd -->\nb"
    with pytest.raises(ValueError, match="bd"):
        markdown.replace_between("no marks", "bd", "new")


def test_every_table_stands_on_a_page() -> None:
    texts = [page.read_text() for page in pages.pages()]
    assert {name for text in texts for name in pages.marks(text)} == set(pages.TABLES)
    for text in texts:
        assert all(f"<!-- end of {name} -->" in text for name in pages.marks(text))


def test_pages_without_tables_stay_as_they_are() -> None:
    assert pages.filled("<!-- a comment -->\n") == "<!-- a comment -->\n"
    with pytest.raises(ValueError, match="'n3v'"):
        pages.filled("<!-- n3v -->\n")


def test_pages_are_what_the_results_make() -> None:
    for page in pages.pages():
        assert pages.filled(page.read_text()) == page.read_text(), f"{page}: run `make charts`"
