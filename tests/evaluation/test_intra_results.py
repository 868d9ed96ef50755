from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("zstandard")

from evaluation import intra


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
