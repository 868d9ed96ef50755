from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("zstandard")

from dfcgs_codec import EncoderOptions
from evaluation.experiments.i_frames import intra, quantised_input
from evaluation.tables import intra as intra_tables
from lab.options import encoder_options


def test_a_part_has_at_most_so_many_gaussians() -> None:
    splat = next(s for s in intra.SPLATS if s.name == "playbot_31k_sh2")
    whole = splat.cloud()
    part = intra.Splat("part", splat.asset, splat.views, is_part=True)
    assert part.cloud().num_gaussians == whole.num_gaussians <= intra._PART


def test_ratios_are_at_the_others_psnr() -> None:
    ours = [{"bytes": 100, "psnr": 30.0}, {"bytes": 400, "psnr": 40.0}]
    assert intra.against(ours, {"bytes": 1000, "psnr": 35.0}) == pytest.approx(0.2)
    assert intra.against(ours, {"bytes": 1000, "psnr": 41.0}) is None


def test_curves_differ_in_their_options_only() -> None:
    points = {curve: intra._codec_point(curve, 20) for curve in intra.CURVES}
    assert len({point.setting for point in points.values()}) == len(points)
    assert np.unique([point.method for point in points.values()]).tolist() == ["dfcgs_intra"]


def test_the_table_of_quantised_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    point = {"qp": 18, "bytes": 300, "psnr": 52.14, "is_kept": True, "ratio": 0.62}
    points = [point, point | {"qp": 8, "ratio": None}, point | {"qp": 34, "is_kept": False}]
    found = {"quantised_input": {"a": {"spz_bytes": 400, "auto": points}}}
    monkeypatch.setattr(intra_tables, "results", found.__getitem__)
    rows = intra_tables.quantised_table().splitlines()[2:]
    assert rows == [
        "| a | 18 | 52.1 dB | 0.75 | -38 % |",
        "| a | 8 | 52.1 dB | 0.75 | beyond its reach |",
    ]


def test_an_input_that_spz_has_quantised_is_found() -> None:
    pytest.importorskip("gaussforge")
    splat = next(s for s in intra.SPLATS if s.name == "playbot_31k_sh2")
    size, cloud = quantised_input.quantised(splat.cloud().take(np.arange(0, 31_000, 16)))
    assert size > 10_000
    exact, notes, _ = quantised_input.coded(cloud, EncoderOptions(qp=16))
    anew, none, _ = quantised_input.coded(cloud, encoder_options(qp=16, exact=False))
    assert any("SH_2 (0.125)" in note for note in notes)
    assert not none
    assert exact < anew
