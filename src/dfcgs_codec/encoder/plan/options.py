"""What a user can ask of the encoder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction
from typing import Any

from dfcgs_codec._version import __version__
from dfcgs_codec.arguments import AnyPath, real, refusal, switch
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder, Profile
from dfcgs_codec.encoder.plan.option_fields import (
    Choice,
    OptionField,
    Real,
    Switch,
    cameras,
    choice,
    frame_rate,
    processes,
    qp_or_none,
    real_or_name,
    whole_or_auto,
)
from dfcgs_codec.encoder.plan.quantiser_steps import MAX_PSNR, MAX_QP, MIN_PSNR, MIN_QP, QUALITIES, Bound
from dfcgs_codec.encoder.plan.tuning import EncoderTuning
from dfcgs_codec.errors import InputError
from dfcgs_codec.model.registry import DEFAULT_MODEL, DEFAULT_PRIOR
from dfcgs_codec.views.camera import Views
from dfcgs_codec.views.region import DEFAULT_MARGIN

MAX_GOF_SIZE = 1 << 16
#: frames at most from one I-frame to the next where the encoder chooses
AUTO_GOF_SIZE = 60
#: the paper's L
PAPER_GOF_SIZE = 10
_MAX_RATE_TERM = 1 << 32
_MAX_VIEWS_MARGIN = 10


#: `{"position": 0.001}`, `[Bound("position", 0.001)]`, pairs, or None
AnyBounds = Mapping[str, float] | Iterable[Bound | tuple[str, float]] | None


def _bounds(name: str, value: Any) -> tuple[Bound, ...]:
    if isinstance(value, Bound):
        return (value,)
    if value is None:
        return ()
    items = value.items() if isinstance(value, Mapping) else value
    try:
        return tuple(item if isinstance(item, Bound) else Bound(*item) for item in items)
    except TypeError:
        raise refusal(name, value, 'a mapping such as {"position": 0.001}') from None


def _tuning(name: str, value: Any) -> EncoderTuning:
    if not isinstance(value, EncoderTuning):
        raise refusal(name, value, "EncoderTuning(...)")
    return value


#: of `EncoderTuning`, what one profile alone heeds
_TUNED_IN = {
    Profile.MAIN: ("motion", "turns", "visibility", "balance", "exact"),
    Profile.PAPER: ("num_neighbours", "latent_step", "refinement"),
}


@dataclass(frozen=True)
class EncoderOptions:
    """Settings of one encode; InputError for a value of the wrong kind or out of range, by its name.

    Numbers may be numpy's; choices are their names in small letters, as the command line takes them
    (`order="input"`, `profile="paper"`), or members of their enumerations.
    """

    quality: OptionField[float, float | str] = OptionField(
        QUALITIES["medium"], real_or_name(QUALITIES | {"lossless": math.inf})
    )
    """PSNR of images in dB, 15 to 70, or "low", "medium", "high" or "transparent" (32, 37, 42 and 50 dB): the
    encoder estimates it and chooses the QP. "lossless", held as infinity: every frame is an I-frame with the
    float32 values of the input."""

    qp: OptionField[float | None, float | None] = OptionField(None, qp_or_none)
    """The quantiser in place of a quality, 0 (finest) to 51: the step doubles every 6. None: as the quality
    needs it."""

    bounds: OptionField[tuple[Bound, ...], AnyBounds] = OptionField((), _bounds)
    """Largest errors that are guaranteed: `{"position": 0.001}`. They replace the steps of their
    attributes."""

    views: OptionField[Views | None, Views | AnyPath | None] = OptionField(None, cameras)
    """The cameras between which viewers stand, as Views or the path of a `cameras.json`, a `transforms.json`
    or a folder of COLMAP. None, the default, is none: only the command line looks for them by itself."""

    views_margin: Real = Real(DEFAULT_MARGIN, real)
    """How far outside the cameras viewers stand, as a share of the distance between cameras."""

    keep_unseen: Switch = Switch(False, switch)
    """Keep what no such viewer sees, in coarser steps, instead of leaving it out."""

    gof_size: OptionField[int | None, int | str | None] = OptionField(None, whole_or_auto)
    """Frames from one I-frame to the next, at most. None: the encoder chooses, 60 at most; 10 in profile
    PAPER; 1 where the quality is "lossless"."""

    frame_rate: OptionField[Fraction, Fraction | float | str] = OptionField(Fraction(30), frame_rate)
    """Frames per second to write into the file: 30, 29.97, "30000/1001" or a Fraction."""

    order: Choice[OutputOrder] = choice(OutputOrder.SEQUENCE)
    """Order of decoded Gaussians: "sequence", the same in all frames; "input", the input's; "free", any."""

    profile: Choice[Profile] = choice(Profile.MAIN)
    """"paper": P-frames as D-FCGS was published, motion by a network and nothing else, for comparison."""

    jobs: OptionField[int, int | None] = OptionField(1, processes)
    """Processes; None: one for each core."""

    tuning: OptionField[EncoderTuning, EncoderTuning] = OptionField(EncoderTuning(), _tuning)
    """Switches for experiments."""

    def __post_init__(self) -> None:
        checks = {
            f"--qp {self.qp}: {MIN_QP} to {MAX_QP} was expected": (
                self.qp is None or MIN_QP <= self.qp <= MAX_QP
            ),
            f"--quality {self.quality:g}: {MIN_PSNR:g} to {MAX_PSNR:g} dB, or lossless, was expected": (
                self.is_lossless or MIN_PSNR <= self.quality <= MAX_PSNR
            ),
            "--qp with --quality lossless: choose one, for a QP quantises": (
                self.qp is None or not self.is_lossless
            ),
            f"--gof-size {self.gof_size} with --quality lossless: P-frames are quantised, so that all "
            "frames are I-frames; leave it out": (not self.is_lossless or self.gof_size in (None, 1)),
            f"--gof-size {self.gof_size}: auto, or 1 to {MAX_GOF_SIZE} was expected": (
                self.gof_size is None or 1 <= self.gof_size <= MAX_GOF_SIZE
            ),
            f"--fps {self.frame_rate}: above 0, with terms below 2**32, was expected": (
                0 < self.frame_rate.numerator < _MAX_RATE_TERM
                and self.frame_rate.denominator < _MAX_RATE_TERM
            ),
            f"--views-margin {self.views_margin}: 0 to {_MAX_VIEWS_MARGIN} was expected": (
                0 <= self.views_margin <= _MAX_VIEWS_MARGIN
            ),
            "--views and --keep-unseen belong to --profile main": (
                self.profile == Profile.MAIN or not (self.views or self.keep_unseen)
            ),
            "--bound with --profile paper: its P-frames have no residual, so that no error can be bounded": (
                not self.bounds or self.profile == Profile.MAIN
            ),
            f"--jobs {self.jobs}: 1 or more was expected": self.jobs >= 1,
        }
        tuned = self.tuning.changed()
        for profile, names in _TUNED_IN.items():
            known = ", ".join(f"EncoderTuning.{name}" for name in names if name in tuned)
            checks[f"{known}: for --profile {profile.name.lower()} alone"] = (
                not known or self.profile == profile
            )
        for message, fine in checks.items():
            if not fine:
                raise InputError(message)

    def tuned(self, **changes: Any) -> EncoderOptions:
        """These options with other values of some fields of `tuning`."""
        return replace(self, tuning=replace(self.tuning, **changes))

    @property
    def is_lossless(self) -> bool:
        """Whether every frame keeps its float32 values."""
        return self.quality == math.inf

    @property
    def intra(self) -> IntraKind:
        """How I-frames are coded."""
        return IntraKind.PLY if self.is_lossless else self.tuning.intra

    @property
    def fixed_gof_size(self) -> int | None:
        """Frames from one I-frame to the next; None: the encoder chooses."""
        if self.gof_size is None and self.is_lossless:
            return 1
        return PAPER_GOF_SIZE if self.gof_size is None and self.profile == Profile.PAPER else self.gof_size

    @property
    def model(self) -> str:
        """Id of the model that the sequence names."""
        return self.tuning.model_id or (DEFAULT_MODEL if self.profile == Profile.PAPER else DEFAULT_PRIOR)

    def describe(self, qp: float) -> str:
        """The settings in one line, for the file's encoder information; `qp` as it was chosen."""
        size = self.fixed_gof_size or "auto"
        parts = [f"dfcgs-codec {__version__}", f"profile={self.profile.name.lower()}", f"model={self.model}"]
        if self.is_lossless:
            parts.append("quality=lossless")
        else:
            parts += [f"quality={self.quality:g}dB"] * (self.qp is None) + [f"qp={qp:g}"]
        parts += [f"gof_size={size}", f"order={self.order.name.lower()}"]
        parts += [f"bound:{bound.attribute}={bound.value:g}" for bound in self.bounds]
        if self.views:
            # how many cameras there are, never where they were read
            parts.append(f"views={len(self.views.cameras)}/{self.views_margin:g}")
        parts += ["keep_unseen"] * self.keep_unseen
        parts += [f"{name}={_shown(value)}" for name, value in self.tuning.changed().items()]
        return " ".join(parts)


def _shown(value: Any) -> str:
    """A value of the tuning without spaces."""
    return str(value.name.lower() if isinstance(value, Enum) else value).replace(" ", "")
