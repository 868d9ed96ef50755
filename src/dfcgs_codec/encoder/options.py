"""What a user can ask of the encoder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import Any

from dfcgs_codec._version import __version__
from dfcgs_codec.arguments import refusal
from dfcgs_codec.bitstream.constants import (
    MAX_LATENT_STEP_LOG2,
    MAX_NEIGHBOURS,
    MIN_LATENT_STEP_LOG2,
    IntraKind,
    OutputOrder,
    Profile,
)
from dfcgs_codec.encoder.option_fields import (
    Cameras,
    Choice,
    NamedReal,
    OptionField,
    Processes,
    Rate,
    Real,
    RealOrNone,
    Switch,
    Text,
    Whole,
    WholeOrAuto,
)
from dfcgs_codec.encoder.rate_control import MAX_PSNR, MAX_QP, MIN_PSNR, MIN_QP, QUALITIES, Bound
from dfcgs_codec.errors import InputError
from dfcgs_codec.model.registry import DEFAULT_MODEL, DEFAULT_PRIOR
from dfcgs_codec.views.region import DEFAULT_MARGIN

MAX_GOF_SIZE = 1 << 16
#: frames at most from one I-frame to the next where the encoder chooses
AUTO_GOF_SIZE = 60
#: the paper's L
PAPER_GOF_SIZE = 10
_MAX_RATE_TERM = 1 << 32
_MAX_VIEWS_MARGIN = 10


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


class Bounds(
    OptionField[tuple[Bound, ...], Mapping[str, float] | Iterable[Bound | tuple[str, float]] | None]
):
    """Largest errors: `{"position": 0.001}`, `[Bound("position", 0.001)]`, pairs, or None."""

    def _convert(self, value: Any) -> tuple[Bound, ...]:
        if isinstance(value, Bound):
            return (value,)
        if value is None:
            return ()
        items = value.items() if isinstance(value, Mapping) else value
        try:
            return tuple(item if isinstance(item, Bound) else Bound(*item) for item in items)
        except TypeError:
            raise refusal(self._name, value, 'a mapping such as {"position": 0.001}') from None


def _log2(value: float) -> float:
    """log2 of a power of two, nan for anything else."""
    if not 0 < value < math.inf or math.frexp(value)[0] != 0.5:
        return math.nan
    return math.frexp(value)[1] - 1


@dataclass(frozen=True)
class EncoderOptions:
    """Settings of one encode; InputError for a value of the wrong kind or out of range, by its name.

    Numbers may be numpy's; choices are their names in small letters, as the command line takes them
    (`order="input"`, `motion="off"`, `intra="ply"`, `profile="paper"`), or members of their enumerations;
    `frame_rate` may be 30, 29.97, "30000/1001" or a Fraction; `bounds` a mapping such as
    `{"position": 0.001}`.

    `quality`: PSNR of images in dB, or "low", "medium", "high" or "transparent" (32, 37, 42 and 50 dB): the
    encoder estimates it and chooses the QP; `qp` 0 (finest) to 51, the step doubles every 6, None: by the
    quality; `bounds` replace the steps of their attributes and guarantee a maximum error; `gof_size` frames
    at most from one I-frame to the next, None: the encoder chooses, 60 at most; `keep_axes` leaves the order
    and signs of each
    Gaussian's axes as they were; one control point for `control_spacing` Gaussians (M of the paper);
    `visibility`: steps are coarser for what shows less; `balance`: steps of attributes follow what they show
    in the first frame; `exact`: values that the
    input has quantised are kept as they are, where that is smaller;
    `views`: the cameras between which viewers stand, as Views or the path of a `cameras.json`, a
    `transforms.json` or a folder of COLMAP; None, the default, is none, as only the command line looks for
    them beside the frames. `views_margin`: how far outside viewers stand, as a share of the distance between
    cameras; `keep_unseen`: what no such viewer sees is kept as well as the rest;
    `intra_zero_bin` is that of I-frames; `model_id` names another model than the profile's own; `jobs`
    processes, None: one for each core.

    With `profile` PAPER P-frames have motion by the model's network and nothing else, that of each control
    point spread over `num_neighbours` Gaussians (the paper's K): `latent_step` is its q', a power of two, and
    a `gof_size` of None means its 10 frames.
    """

    quality: NamedReal = NamedReal(QUALITIES["medium"], QUALITIES)
    qp: RealOrNone = RealOrNone(None, 'a quality has its own option: quality="high"')
    bounds: Bounds = Bounds(())
    gof_size: WholeOrAuto = WholeOrAuto(None)
    intra: Choice[IntraKind] = Choice(IntraKind.CODED)
    order: Choice[OutputOrder] = Choice(OutputOrder.SEQUENCE)
    frame_rate: Rate = Rate(Fraction(30))
    zero_bin: Real = Real(0.6)
    keep_axes: Switch = Switch(False)
    motion: Choice[MotionMode] = Choice(MotionMode.AUTO)
    control_spacing: Whole = Whole(70)
    num_neighbours: Whole = Whole(30)
    profile: Choice[Profile] = Choice(Profile.MAIN)
    model_id: Text = Text(None)
    latent_step: Real = Real(1.0)
    refinement: Choice[RefinementMode] = Choice(RefinementMode.AUTO)
    visibility: Switch = Switch(True)
    balance: Switch = Switch(True)
    exact: Switch = Switch(True)
    views: Cameras = Cameras(None)
    views_margin: Real = Real(DEFAULT_MARGIN)
    keep_unseen: Switch = Switch(False)
    intra_zero_bin: Real = Real(0.6)
    jobs: Processes = Processes(1)

    def __post_init__(self) -> None:
        checks = {
            f"--qp {self.qp}: {MIN_QP} to {MAX_QP} was expected": (
                self.qp is None or MIN_QP <= self.qp <= MAX_QP
            ),
            f"--psnr {self.quality}: {MIN_PSNR:g} to {MAX_PSNR:g} dB was expected": (
                MIN_PSNR <= self.quality <= MAX_PSNR
            ),
            f"--gof-size {self.gof_size}: auto, or 1 to {MAX_GOF_SIZE} was expected": (
                self.gof_size is None or 1 <= self.gof_size <= MAX_GOF_SIZE
            ),
            f"--fps {self.frame_rate}: above 0, with terms below 2**32, was expected": (
                0 < self.frame_rate.numerator < _MAX_RATE_TERM
                and self.frame_rate.denominator < _MAX_RATE_TERM
            ),
            f"--control-spacing {self.control_spacing}: 1 or more was expected": self.control_spacing >= 1,
            f"--control-neighbours {self.num_neighbours}: 1 to {MAX_NEIGHBOURS} was expected": (
                1 <= self.num_neighbours <= MAX_NEIGHBOURS
            ),
            f"--latent-step {self.latent_step}: a power of two, 1/16 to 64, was expected": (
                MIN_LATENT_STEP_LOG2 <= _log2(self.latent_step) <= MAX_LATENT_STEP_LOG2
            ),
            "--motion, --steps, --balance and --exact belong to --profile main": (
                self.profile == Profile.MAIN
                or (self.motion == MotionMode.AUTO and self.visibility and self.balance and self.exact)
            ),
            f"--views-margin {self.views_margin}: 0 to {_MAX_VIEWS_MARGIN} was expected": (
                0 <= self.views_margin <= _MAX_VIEWS_MARGIN
            ),
            "--views and --keep-unseen belong to --profile main": (
                self.profile == Profile.MAIN or not (self.views or self.keep_unseen)
            ),
            "--latent-step, --refinement and --control-neighbours belong to --profile paper": (
                self.profile == Profile.PAPER
                or (self.latent_step, self.refinement, self.num_neighbours) == (1.0, RefinementMode.AUTO, 30)
            ),
            "--bound with --profile paper: its P-frames have no residual, so that no error can be bounded": (
                not self.bounds or self.profile == Profile.MAIN
            ),
            f"--jobs {self.jobs}: 1 or more was expected": self.jobs >= 1,
            f"zero_bin {self.zero_bin}: 0.5 to 1 was expected": 0.5 <= self.zero_bin <= 1.0,
            f"intra_zero_bin {self.intra_zero_bin}: 0.5 to 1 was expected": 0.5 <= self.intra_zero_bin <= 1.0,
        }
        for message, fine in checks.items():
            if not fine:
                raise InputError(message)

    @property
    def latent_step_log2(self) -> int:
        """log2 of `latent_step`."""
        return int(_log2(self.latent_step))

    @property
    def model(self) -> str:
        """Id of the model that the sequence names."""
        return self.model_id or (DEFAULT_MODEL if self.profile == Profile.PAPER else DEFAULT_PRIOR)

    def describe(self, qp: float) -> str:
        """The settings in one line, for the file's encoder information; `qp` as it was chosen."""
        if self.profile == Profile.PAPER:
            return self._describe_paper(qp)
        bounds = "".join(f" bound {bound.attribute}={bound.value:g}" for bound in self.bounds)
        return (
            f"dfcgs-codec {__version__} {self._asked}qp={qp:g} gof_size={self.gof_size or 'auto'}"
            f" model={self.model}"
            f" motion={self.motion.value} control={self.control_spacing}"
            f" steps={self._steps}{'' if self.exact else ' exact=off'}{self._seen}"
            f" intra={self.intra.name.lower()} order={self.order.name.lower()}{bounds}"
        )

    @property
    def _asked(self) -> str:
        return f"quality={self.quality:g}dB " if self.qp is None else ""

    @property
    def _steps(self) -> str:
        if not self.visibility:
            return "uniform"
        return "visibility" if self.balance else "visibility/nobalance"

    @property
    def _seen(self) -> str:
        """How many cameras there are, never where they were read."""
        views = f" views={len(self.views.cameras)}/{self.views_margin:g}" if self.views else ""
        return views + (" keep_unseen" if self.keep_unseen else "")

    def _describe_paper(self, qp: float) -> str:
        return (
            f"dfcgs-codec {__version__} profile=paper model={self.model} {self._asked}qp={qp:g}"
            f" gof_size={self.gof_size or PAPER_GOF_SIZE} latent_step={self.latent_step:g}"
            f" control={self.control_spacing}"
            f" neighbours={self.num_neighbours} refinement={self.refinement.value}"
            f" intra={self.intra.name.lower()} order={self.order.name.lower()}"
        )
