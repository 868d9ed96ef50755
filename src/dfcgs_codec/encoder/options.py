"""What a user can ask of the encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

from dfcgs_codec._version import __version__
from dfcgs_codec.bitstream.constants import MAX_NEIGHBOURS, Compensation, ControlRule, IntraKind, OutputOrder
from dfcgs_codec.encoder.rate_control import MAX_QP, MIN_QP, QUALITIES, Bound
from dfcgs_codec.errors import InputError

MAX_GOF_SIZE = 1 << 16
#: frames at most from one I-frame to the next where the encoder chooses
AUTO_GOF_SIZE = 60
_MAX_RATE_TERM = 1 << 32


class MotionMode(Enum):
    """What P-frames are made of."""

    #: motion and residual, each where it pays
    AUTO = "auto"
    #: residual alone
    OFF = "off"
    #: motion in every frame that changes, whether it pays or not, and residual
    ON = "on"
    #: motion alone, no residual: drifts away from the input
    ONLY = "only"


@dataclass(frozen=True)
class EncoderOptions:
    """Settings of one encode; InputError for values out of range.

    `qp` 0 (finest) to 51, the step doubles every 6; `bounds` replace the steps of their attributes and
    guarantee a maximum error; `gof_size` frames at most from one I-frame to the next, None: the encoder
    chooses, 60 at most; `keep_axes` leaves
    the order and signs of each Gaussian's axes as they were; `compensation` SPREAD is the paper's rule, with
    control points moved as they are, each one's motion spread over `num_neighbours` Gaussians (K); one
    control point for `control_spacing` Gaussians (M of the paper);
    `visibility`: steps of residuals are coarser for what shows less;
    `jobs` processes.
    """

    qp: float = QUALITIES["medium"]
    bounds: tuple[Bound, ...] = ()
    gof_size: int | None = None
    intra: IntraKind = IntraKind.CODED
    order: OutputOrder = OutputOrder.SEQUENCE
    frame_rate: Fraction = Fraction(30)
    zero_bin: float = 0.6
    keep_axes: bool = False
    motion: MotionMode = MotionMode.AUTO
    compensation: Compensation = Compensation.GATHER
    control_rule: ControlRule = ControlRule.FARTHEST
    control_spacing: int = 70
    num_neighbours: int = 30
    visibility: bool = True
    jobs: int = 1

    def __post_init__(self) -> None:
        checks = {
            f"--qp {self.qp}: {MIN_QP} to {MAX_QP} was expected": MIN_QP <= self.qp <= MAX_QP,
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
            f"--jobs {self.jobs}: 1 or more was expected": self.jobs >= 1,
            f"zero_bin {self.zero_bin}: 0.5 to 1 was expected": 0.5 <= self.zero_bin <= 1.0,
        }
        for message, fine in checks.items():
            if not fine or math.isnan(self.qp):
                raise InputError(message)

    def describe(self) -> str:
        """The settings in one line, for the file's encoder information."""
        motion = self.motion.value + ("/spread" if self.compensation == Compensation.SPREAD else "")
        bounds = "".join(f" bound {bound.attribute}={bound.value:g}" for bound in self.bounds)
        return (
            f"dfcgs-codec {__version__} qp={self.qp:g} gof_size={self.gof_size or 'auto'}"
            f" motion={motion} control={self.control_rule.name.lower()}/{self.control_spacing}"
            f" steps={'visibility' if self.visibility else 'uniform'}"
            f" intra={self.intra.name.lower()} order={self.order.name.lower()}{bounds}"
        )
