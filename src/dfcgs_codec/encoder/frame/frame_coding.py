"""One frame to chunks: the walk that decoders take, told what is wanted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute, IntraKind, Tool
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.frame_headers import ControlHeader, InterHeader, IntraHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.topology import TopologyGoal
from dfcgs_codec.codec.frame.walk import (
    InterFrameGoal,
    IntraFrameGoal,
    MotionGoal,
    code_escapes,
    code_inter_frame,
    code_intra_frame,
)
from dfcgs_codec.codec.intra.verbatim import VerbatimSymbols
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.state.planes import verbatim_columns
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.gaussians import GaussianCloud


@dataclass(frozen=True)
class CodedFrame:
    """A frame's chunks, and what a decoder will hold after it.

    `source`: which row of survivors, then births, stands where; None where there are no births.
    """

    writer: FrameWriter
    state: GofState
    source: Int64 | None = None

    @staticmethod
    def of(writer: FrameWriter, state: GofState, source: Int64 | None = None) -> CodedFrame:
        """With the hash of the state in its header."""
        writer.header = replace(writer.header, frame_hash=state.frame.hash())
        return CodedFrame(writer, state, source)

    @cached_property
    def data(self) -> bytes:
        """All chunks."""
        return self.writer.data()

    @property
    def kind(self) -> str:
        """I, P, or skip."""
        header = self.writer.header
        if isinstance(header, IntraHeader):
            return "I"
        return "P" if header.changes else "skip"

    def with_escapes(self, escapes: Escapes | None) -> CodedFrame:
        """With its escapes, rows in GoF order: a header that says so, their chunk behind all others."""
        before = self.state.frame.escapes
        if (before.payload() if before else b"") == (escapes.payload() if escapes else b""):
            return self
        writer = self.writer.copy()
        writer.header = writer.header.with_escapes()
        on_grid = replace(self.state, frame=self.state.frame.on_grid())
        return CodedFrame.of(writer, code_escapes(writer, escapes or Escapes.none(), on_grid), self.source)


def topology_goal(
    kept: Int64, num_before: int, births: IntraTarget | None, inputs: Int64 | None = None
) -> TopologyGoal:
    """Who goes and comes in a frame, of `num_before` Gaussians; see TopologyGoal."""
    num_removals = num_before - len(kept)
    if births is None:
        return TopologyGoal(TopologyHeader(num_removals, False, 0, None), kept, None, inputs)
    header = TopologyHeader(num_removals, False, len(births.positions), births.grid, births.steps)
    return TopologyGoal(header, kept, births, inputs)


def coded_intra(writer: FrameWriter, target: IntraTarget, control: ControlHeader) -> CodedFrame:
    """A `coded` I-frame."""
    count, permuted = len(target.positions), target.permutation is not None
    header = IntraHeader(b"", IntraKind.CODED, count, permuted, control, target.grid, target.steps)
    return CodedFrame.of(writer, code_intra_frame(writer, IntraFrameGoal(header, target)))


def coded_empty(writer: FrameWriter) -> CodedFrame:
    """An I-frame without Gaussians."""
    return CodedFrame.of(writer, code_intra_frame(writer, IntraFrameGoal(IntraHeader.empty(b""))))


def coded_verbatim(
    writer: FrameWriter, cloud: GaussianCloud, permutation: Int64 | None, control: ControlHeader
) -> CodedFrame:
    """A `ply` I-frame of float32 values in canonical order."""
    count, permuted = cloud.num_gaussians, permutation is not None
    header = IntraHeader(b"", IntraKind.PLY, count, permuted, control, None, None)
    symbols = VerbatimSymbols(verbatim_columns(cloud), permutation)
    return CodedFrame.of(writer, code_intra_frame(writer, IntraFrameGoal(header, verbatim=symbols)))


def coded_inter(
    writer: FrameWriter,
    symbols: InterSymbols,
    before: GofState,
    steps: tuple[Mapping[Attribute, int], Mapping[Attribute, int]],
    motion: MotionGoal | None = None,
    topology: TopologyGoal | None = None,
) -> CodedFrame:
    """A P-frame after the frame that left `before`; `steps` in grid units, and weights that have just these.

    With a `topology`, `symbols` and `motion` are those of the survivors.
    """
    present = sorted(symbols.activity)
    used = {a: steps[0][a] for a in present}
    levels = {a: steps[1][a] for a in present if steps[1]}
    wanted = {
        Tool.MOTION: motion is not None,
        Tool.TOPOLOGY: topology is not None,
        Tool.VISIBILITY: bool(levels),
    }
    tools = frozenset(tool for tool, is_used in wanted.items() if is_used)
    goal = InterFrameGoal(InterHeader(b"", tools, used, levels), symbols, motion, topology)
    state, change = code_inter_frame(writer, goal, before)
    return CodedFrame.of(writer, state, None if change is None else change.source)
