from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("numba")

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence
from evaluation.experiments import refresh
from tests.helpers import all_changing, real_cloud


def errors(tmp_path: Path, period: int | None) -> tuple[list[float], int]:
    """Mean error of colours of each frame, and bytes."""
    frames = all_changing(real_cloud(400), 6)
    path = tmp_path / f"{period}.dgs"
    with refresh.refreshing(period):
        encode_sequence(frames, path, EncoderOptions(qp=30, gof_size=6), force=True)
    clouds = [decoded.cloud() for decoded in decode_sequence(path)]
    found = []
    for source, decoded in zip(frames, clouds, strict=True):
        nearest = np.abs(source.sh_dc[:, None] - decoded.sh_dc[None]).sum(axis=2).min(axis=1)
        found.append(float(nearest.mean()))
    return found, path.stat().st_size


def test_a_refresh_mends_and_costs(tmp_path: Path) -> None:
    (plain, small), (mended, large) = errors(tmp_path, None), errors(tmp_path, 3)
    assert plain[:3] == mended[:3]
    assert mended[3] < plain[3]
    assert large > small
    # and nothing stays patched
    assert errors(tmp_path, None) == (plain, small)


def test_ratios_are_at_equal_psnr() -> None:
    points = [{"bytes": 100 * 2**k, "psnr": 30.0 + k} for k in range(3)]
    dearer = [{"bytes": 2 * p["bytes"], "psnr": p["psnr"]} for p in points]
    curves = {name: dearer if name.startswith("I") else points for name in refresh.variants()}
    found = refresh.summary(curves, 61)
    assert found["none"] == {"ratio_to_none": 1.0, "seek": 31.0}
    assert found["I 10"]["ratio_to_none"] == pytest.approx(2.0)
    assert found["I 10"]["seek"] == pytest.approx((6 * 55 + 1) / 61, abs=0.05)
