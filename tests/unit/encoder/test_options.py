from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest

from dfcgs_codec import Bound, EncoderOptions
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from dfcgs_codec.errors import InputError


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("qp", -0.1),
        ("qp", 51.1),
        ("qp", float("nan")),
        ("qp", float("inf")),
        ("quality", 14.9),
        ("quality", 70.1),
        ("quality", float("nan")),
        ("gof_size", 0),
        ("gof_size", (1 << 16) + 1),
        ("frame_rate", Fraction(0)),
        ("frame_rate", Fraction(-30)),
        ("frame_rate", Fraction(10**30)),
        ("jobs", 0),
        ("zero_bin", 0.4),
        ("zero_bin", 1.1),
    ],
)
def test_values_out_of_range_are_refused_by_name(name: str, value: Any) -> None:
    names = {"gof_size": "--gof-size", "frame_rate": "--fps", "zero_bin": "zero_bin", "quality": "--psnr"}
    with pytest.raises(InputError, match=names.get(name, f"--{name}")):
        EncoderOptions(**{name: value})


def test_limits_themselves_are_fine() -> None:
    for options in (
        {"qp": 0},
        {"qp": 51},
        {"quality": 15},
        {"quality": 70},
        {"gof_size": 1},
        {"gof_size": 1 << 16},
        {"zero_bin": 0.5},
    ):
        EncoderOptions(**options)


def test_describe_is_one_line_with_all_that_matters() -> None:
    options = EncoderOptions(
        qp=20.5, bounds=(Bound("alpha", 0.01),), gof_size=7, intra=IntraKind.PLY, order=OutputOrder.FREE
    )
    line = options.describe(20.5)
    assert "quality" not in line
    assert "quality=40dB qp=25.3" in EncoderOptions(quality=40).describe(25.3)
    for part in ("qp=20.5", "gof_size=7", "intra=ply", "order=free", "bound alpha=0.01"):
        assert part in line
    assert "\n" not in line


def test_a_qp_comes_before_a_quality_and_a_quality_may_have_a_name() -> None:
    assert EncoderOptions(quality="High").quality == 42.0
    assert EncoderOptions().quality == 37.0
    assert EncoderOptions().qp is None
    with pytest.raises(InputError, match='quality="high"'):
        EncoderOptions(qp="high")  # type: ignore[arg-type]
