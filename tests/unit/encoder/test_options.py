from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest

from dfcgs_codec import Bound, EncoderOptions, EncoderTuning
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from dfcgs_codec.encoder.plan.quantiser_steps import REFERENCE_STEPS
from dfcgs_codec.encoder.plan.tuning import MotionMode
from dfcgs_codec.errors import InputError
from lab.options import encoder_options


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
    names = {"gof_size": "--gof-size", "frame_rate": "--fps", "zero_bin": "EncoderTuning.zero_bin"}
    with pytest.raises(InputError, match=names.get(name, f"--{name}")):
        encoder_options(**{name: value})


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
        encoder_options(**options)


def test_describe_is_one_line_with_all_that_matters() -> None:
    options = encoder_options(
        qp=20.5,
        bounds=(Bound("alpha", 0.01),),
        gof_size=7,
        intra=IntraKind.PLY,
        order=OutputOrder.FREE,
        turns=False,
    )
    line = options.describe(20.5)
    assert "quality" not in line
    assert "quality=40dB qp=25.3" in EncoderOptions(quality=40).describe(25.3)
    for part in ("qp=20.5", "gof_size=7", "intra=ply", "order=free", "bound:alpha=0.01", "turns=False"):
        assert part in line
    assert "\n" not in line


def test_a_qp_comes_before_a_quality_and_a_quality_may_have_a_name() -> None:
    assert EncoderOptions(quality="High").quality == 42.0
    assert EncoderOptions().quality == 37.0
    assert EncoderOptions().qp is None
    with pytest.raises(InputError, match='quality="high"'):
        EncoderOptions(qp="high")  # type: ignore[arg-type]


def test_lossless_has_i_frames_only_of_float32_values() -> None:
    options = EncoderOptions(quality="lossless")
    assert (options.is_lossless, options.intra, options.fixed_gof_size) == (True, IntraKind.PLY, 1)
    assert EncoderOptions(quality=math.inf) == options
    assert "quality=lossless gof_size=1" in options.describe(28)
    assert (EncoderOptions().intra, EncoderOptions().fixed_gof_size) == (IntraKind.CODED, None)
    assert EncoderOptions(profile="paper").fixed_gof_size == 10
    for contradiction in ({"qp": 20}, {"gof_size": 2}):
        with pytest.raises(InputError, match="with --quality lossless"):
            EncoderOptions(quality="lossless", **contradiction)


def test_tuning_is_checked_and_changed_by_name() -> None:
    options = EncoderOptions(qp=20, tuning=EncoderTuning(motion="off")).tuned(balance=False)
    assert (options.qp, options.tuning) == (20, EncoderTuning(motion="off", balance=False))
    assert options.tuning.changed() == {"motion": MotionMode.OFF, "balance": False}
    with pytest.raises(InputError, match=r"EncoderOptions.tuning: found .* expected EncoderTuning"):
        EncoderOptions(tuning={"motion": "off"})  # type: ignore[arg-type]


@pytest.mark.parametrize("steps", [{}, 1.0, dict.fromkeys(REFERENCE_STEPS, 0.0), {"position": 1.0}])
def test_reference_steps_are_steps_of_all_attributes(steps: Any) -> None:
    with pytest.raises(InputError, match=r"EncoderTuning\.reference_steps"):
        EncoderTuning(reference_steps=steps)
