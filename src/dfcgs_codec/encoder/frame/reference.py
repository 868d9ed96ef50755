"""What a segment's closed loop holds: frames of the input, what was coded of them, where a run began."""

from __future__ import annotations

from dataclasses import dataclass, field

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.encoder.frame.frame_coding import CodedFrame
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.encoder.frame.targets import Planes
from dfcgs_codec.encoder.matching.identity import Members, Succession
from dfcgs_codec.encoder.plan.allocation import Placing
from dfcgs_codec.encoder.residual.appearing import ColourSteps
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource


def check_announced(source: FrameSource, index: int, cloud: GaussianCloud, sh_degree: int) -> None:
    """InputError where frame `index`, as it was read, is another than `source` has said of it."""
    found, planned = (cloud.num_gaussians, cloud.sh_degree), (source.headers[index].num_gaussians, sh_degree)
    if found != planned:
        raise InputError(
            f"frame {source.numbers[index]}: {found[0]} Gaussians of SH degree {found[1]}, but "
            f"{planned[0]} of SH degree {planned[1]} were announced; frames must not change meanwhile"
        )


@dataclass(frozen=True)
class CodedGof:
    """A closed GoF: its first frame and the chunks of each of its frames."""

    first_frame: int
    frames: list[bytes] = field(default_factory=list)


@dataclass
class CodedSegment:
    """GoFs of a run of frames and what was measured on them."""

    gofs: list[CodedGof] = field(default_factory=list)
    report: EncodeReport = field(default_factory=EncodeReport)


@dataclass(frozen=True)
class RunStart:
    """Where a tracked run got its order, axis names and steps of I-frames from."""

    cloud: GaussianCloud
    rank: Int64
    placing: Placing


@dataclass(frozen=True)
class InputFrame:
    """A frame of the input, and what is to be said of it.

    `cloud` has the values that the grids hold, `planes` its integers, in its own order; `escapes` are all
    others; `cover` classes (N,), None: all 0.
    """

    original: GaussianCloud
    cloud: GaussianCloud
    planes: Planes
    escapes: Escapes | None
    notes: list[str]
    cover: Int64 | None = None


@dataclass(frozen=True)
class CodedReference:
    """The closed loop after a frame: what was coded, who its Gaussians are, what they should have been.

    `cloud` and `planes` are those of the input, in its order; `moved` (N, 3): how far they went in one
    frame, or nan; `is_held`: attributes changed that P-frames of the profile do not carry; `succession` from
    the frame before, `intra_steps` of an I-frame that P-frames are measured by.
    """

    coded: CodedFrame
    members: Members
    target: Planes
    cloud: GaussianCloud
    planes: Planes
    intra_bytes: int
    moved: Float64 | None = None
    is_held: bool = False
    colours: ColourSteps | None = None
    succession: Succession | None = None
    intra_steps: IntraSteps | None = None
