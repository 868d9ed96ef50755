from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("numba")

from dfcgs_codec import EncoderTuning
from evaluation.experiments.motion import VARIANTS, compare, variant_point


def rows(scale_inter: float) -> list[dict[str, object]]:
    """Three points, six decibel apart, whose P-frames take `scale_inter` times the bytes."""
    found = []
    for index, psnr in enumerate((42.0, 36.0, 30.0)):
        inter = int(1000 * scale_inter / 2**index)
        kinds = {"I": 1000 // 2**index, "P": inter, "skip": 0}
        found.append(
            {
                "bytes": kinds["I"] + inter,
                "psnr": psnr,
                "bytes_by_frame_type": kinds,
                "frame_types": "IP",
                "bytes_by_attribute": {"POSITION": index},
            }
        )
    return found


def test_files_and_p_frames_are_compared_at_equal_psnr() -> None:
    found = compare(rows(1.0), rows(3.0))
    assert abs(found["bd_rate_file"] - 100) < 1
    assert abs(found["bd_rate_inter"] - 200) < 1
    assert found["bytes_by_attribute"] == {"POSITION": 1}


def test_every_variant_is_a_tuning() -> None:
    for variant in VARIANTS.values():
        assert set(EncoderTuning(**variant).changed()) == set(variant)
        assert json.loads(variant_point("no motion", 28).encode(Path("a"), Path("b"))[-1])["qp"] == 28
