"""Header of a TOPOLOGY chunk, `write` beside `read` (spec section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.fields import at_most, read_bounded, read_flag
from dfcgs_codec.bitstream.frame_headers import OUTPUT_ORDER, IntraSteps, SortGrid, intra_streams
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader

#: the stream that says who goes
REMOVALS = "REMOVALS"


@dataclass(frozen=True)
class TopologyHeader:
    """Which Gaussians go and come.

    `num_births` Gaussians are coded like an I-frame with `sort_grid` and `steps`, absent where none come.
    `has_permutation`: whether places in the output are coded.
    """

    num_removals: int
    has_permutation: bool
    num_births: int
    sort_grid: SortGrid | None
    steps: IntraSteps | None = None

    def streams(self, sh_degree: int) -> list[str]:
        """What its streams hold, in their order."""
        births = intra_streams(sh_degree) if self.num_births else []
        return [REMOVALS] * (self.num_removals > 0) + births + [OUTPUT_ORDER] * self.has_permutation

    def write(self, writer: ByteWriter) -> None:
        """All fields in order; grid and steps where there are births."""
        writer.uvarint(self.num_removals)
        writer.u8(int(self.has_permutation))
        writer.uvarint(self.num_births)
        if self.sort_grid is not None and self.steps is not None:
            self.sort_grid.write(writer)
            self.steps.write(writer)

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader, num_gaussians: int) -> TopologyHeader:
        """Refuses to remove all of `num_gaussians`, those before, and more of them than the level allows."""
        offset, limit = reader.offset, sequence.limits.max_gaussians
        removals = read_bounded(reader.uvarint, limit, "num_removals", reader)
        has_permutation = read_flag(reader, "has_permutation")
        births = read_bounded(reader.uvarint, limit, "num_births", reader)
        grid, steps = None, None
        if births:
            grid, steps = SortGrid.read(reader), IntraSteps.read(reader, sequence)
        at_most(removals, num_gaussians - 1, "num_removals", offset)
        at_most(num_gaussians - removals + births, limit, "num_gaussians", offset)
        return TopologyHeader(removals, has_permutation, births, grid, steps)
