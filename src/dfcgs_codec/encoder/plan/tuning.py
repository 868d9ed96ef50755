"""Switches for experiments: how the encoder works inside, which nobody with a capture needs to set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from dfcgs_codec.arguments import real, refusal, switch, whole
from dfcgs_codec.bitstream.constants import (
    MAX_LATENT_STEP_LOG2,
    MAX_NEIGHBOURS,
    MIN_LATENT_STEP_LOG2,
    Attribute,
    IntraKind,
)
from dfcgs_codec.encoder.plan.option_fields import Choice, OptionField, Real, Switch, Whole, choice
from dfcgs_codec.encoder.plan.quantiser_steps import REFERENCE_STEPS
from dfcgs_codec.errors import InputError


class MotionMode(Enum):
    """What P-frames are made of."""

    #: motion and residual, each where it pays
    AUTO = "auto"
    #: residual alone
    OFF = "off"
    #: motion alone, no residual: drifts away from the input
    ONLY = "only"


class RefinementMode(Enum):
    """Whether the model of profile PAPER changes the colours of P-frames."""

    #: in frames whose colours come nearer to the input's
    AUTO = "auto"
    OFF = "off"
    #: in every frame that moves, as published
    ON = "on"


_Steps = Mapping[Attribute, float] | None


def _steps(name: str, value: Any) -> _Steps:
    if value is None:
        return None
    if not isinstance(value, Mapping) or set(value) != set(REFERENCE_STEPS):
        raise refusal(name, value, "a step by Attribute, of every attribute, or None")
    steps = {attribute: real(name, step) for attribute, step in value.items()}
    if not all(0 < step < math.inf for step in steps.values()):
        raise refusal(name, value, "steps above 0")
    return steps


def _text(name: str, value: Any) -> str | None:
    if value is not None and not isinstance(value, str):
        raise refusal(name, value, "a text or None")
    return value


def _log2(value: float) -> float:
    if not 0 < value < math.inf or math.frexp(value)[0] != 0.5:
        return math.nan
    return math.frexp(value)[1] - 1


@dataclass(frozen=True)
class EncoderTuning:
    """Switches for experiments, as in `EncoderOptions(tuning=EncoderTuning(motion="off"))`.

    The defaults are what was measured to be best; percentages below are of whole files at equal PSNR, in the
    mean over the evaluation scenes (`docs/notebook/`). None of this is on the command line, and what is here
    may change with any version. Choices are their names in small letters or members of their enumerations.
    Raises InputError for a value of the wrong kind or out of range, by its name.
    """

    intra: Choice[IntraKind] = choice(IntraKind.CODED)
    """"ply": I-frames are the float32 values of the input, P-frames between them stay quantised, as in the
    published D-FCGS; such an I-frame takes 10 to 23 times the bytes of one at 40 dB. In contrast
    `EncoderOptions(quality="lossless")` has I-frames only and keeps every frame as it is."""

    visibility: Switch = Switch(True, switch)
    """Steps are coarser for Gaussians that show less. False, one step for all: +15 to +41 % of I-frames, and
    +34 % of files, on objects."""

    balance: Switch = Switch(True, switch)
    """Steps of attributes follow how much each shows in small patches of the first frame. False: +4 % of
    I-frames (-1 to +7)."""

    exact: Switch = Switch(True, switch)
    """Values that another tool has quantised already are kept as they are, where that is smaller. False: the
    files of input that went through SPZ are 16 to 92 % larger."""

    zero_bin: Real = Real(0.6, real)
    """In P-frames a residual below this many steps is coded as 0; 0.5 rounds to the nearest step."""

    intra_zero_bin: Real = Real(0.6, real)
    """The same in I-frames."""

    reference_steps: OptionField[_Steps, _Steps] = OptionField(None, _steps)
    """Steps at QP 22 by Attribute, in place of `quantiser_steps.REFERENCE_STEPS`; whether another
    proportion of steps is better is asked by `evaluation/experiments/i_frames/allocation.py`."""

    motion: Choice[MotionMode] = choice(MotionMode.AUTO)
    """"auto": control points carry Gaussians along where that pays; "off": nowhere, +33 % of files; "only":
    everywhere, and no residual, which drifts away from the input."""

    turns: Switch = Switch(True, switch)
    """Control points turn what they carry. False, they only shift it: +10 %."""

    control_spacing: Whole = Whole(70, whole)
    """Gaussians to one control point (M of the paper)."""

    model_id: OptionField[str | None, str | None] = OptionField(None, _text)
    """Id of a model other than the profile's own; it must be installed or registered."""

    num_neighbours: Whole = Whole(30, whole)
    """Profile PAPER: Gaussians that a control point moves (K of the paper)."""

    latent_step: Real = Real(1.0, real)
    """Profile PAPER: q' of the paper, a power of two, 1/16 to 64."""

    refinement: Choice[RefinementMode] = choice(RefinementMode.AUTO)
    """Profile PAPER: colour refinement where it brings colours nearer, "on" in every frame as published, or
    "off"."""

    def __post_init__(self) -> None:
        checks = {
            f"control_spacing {self.control_spacing}: 1 or more was expected": self.control_spacing >= 1,
            f"num_neighbours {self.num_neighbours}: 1 to {MAX_NEIGHBOURS} was expected": (
                1 <= self.num_neighbours <= MAX_NEIGHBOURS
            ),
            f"latent_step {self.latent_step}: a power of two, 1/16 to 64, was expected": (
                MIN_LATENT_STEP_LOG2 <= _log2(self.latent_step) <= MAX_LATENT_STEP_LOG2
            ),
            f"zero_bin {self.zero_bin}: 0.5 to 1 was expected": 0.5 <= self.zero_bin <= 1.0,
            f"intra_zero_bin {self.intra_zero_bin}: 0.5 to 1 was expected": 0.5 <= self.intra_zero_bin <= 1.0,
        }
        for message, fine in checks.items():
            if not fine:
                raise InputError(f"EncoderTuning.{message}")

    @property
    def latent_step_log2(self) -> int:
        """log2 of `latent_step`."""
        return int(_log2(self.latent_step))

    def changed(self) -> dict[str, Any]:
        """Fields that differ from their defaults, by name."""
        return {name: value for name, value in vars(self).items() if value != getattr(type(self), name)}
