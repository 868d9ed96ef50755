"""Headers of frames, `write` beside `read` (spec sections 5 and 6)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from dfcgs_codec.bitstream.constants import (
    FRAME_HASH_BYTES,
    MAX_COARSE_LOG2,
    MAX_CONTROL_POINTS,
    MAX_CONTROL_SHIFT,
    MAX_SORT_BITS,
    MAX_SORT_SHIFT,
    MAX_THIN_EXPONENT,
    MAX_THIN_OCTAVES,
    PROFILE_TOOLS,
    STATE_LIMIT,
    Attribute,
    IntraKind,
    Profile,
    Tool,
)
from dfcgs_codec.bitstream.fields import (
    at_most,
    mask_of,
    read_bounded,
    read_enum,
    read_flag,
    read_levels,
    read_mask,
    read_point,
    read_steps,
    write_levels,
    write_steps,
)
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.errors import CorruptBitstream, UnsupportedBitstream


@dataclass(frozen=True)
class SortGrid:
    """Cube and resolution of the position tree (spec section 9.1)."""

    shift: int
    bits: int
    origin: tuple[int, int, int]
    has_excess: bool

    def write(self, writer: ByteWriter) -> None:
        """shift and bits, three origins, the excess flag."""
        writer.u8(self.shift)
        writer.u8(self.bits)
        for value in self.origin:
            writer.svarint(value)
        writer.u8(int(self.has_excess))

    @staticmethod
    def read(reader: ByteReader) -> SortGrid:
        """Refuses shifts, bits and origins out of range."""
        shift = read_bounded(reader.u8, MAX_SORT_SHIFT, "sort_shift", reader)
        bits = read_bounded(reader.u8, MAX_SORT_BITS, "sort_bits", reader)
        origin = read_point(reader, STATE_LIMIT, "sort_origin")
        return SortGrid(shift, bits, origin, read_flag(reader, "has_excess"))


@dataclass(frozen=True)
class ControlHeader:
    """Which Gaussians are control points: one for every `spacing` (spec section 14.1)."""

    spacing: int
    shift: int

    def write(self, writer: ByteWriter) -> None:
        """Spacing, cell shift."""
        writer.uvarint(self.spacing)
        writer.u8(self.shift)

    @staticmethod
    def read(reader: ByteReader) -> ControlHeader:
        """Refuses spacing 0, and shifts out of range."""
        offset = reader.offset
        spacing = read_bounded(reader.uvarint, STATE_LIMIT, "control_spacing", reader)
        if spacing == 0:
            raise CorruptBitstream("control_spacing is 0", offset=offset)
        return ControlHeader(spacing, read_bounded(reader.u8, MAX_CONTROL_SHIFT, "control_shift", reader))


#: that of a frame without Gaussians, which says nothing
NO_CONTROL = ControlHeader(1, 0)


@dataclass(frozen=True)
class IntraSteps:
    """Quantiser steps of an I-frame, or of births, and how they follow visibility (spec section 9.6).

    `steps` are those of Gaussians of the weight `levels`, sixteenths of an octave, by attribute. Positions
    are coarser by up to 2**`coarse_log2`; axis 2 is companded over `thin_octaves` of its ratio to axis 1
    (spec section 9.7); two quantisers take turns in `alternating` attributes (spec section 9.8).
    """

    steps: dict[Attribute, int]
    coarse_log2: int
    levels: dict[Attribute, int]
    thin_octaves: int
    alternating: frozenset[Attribute]

    def write(self, writer: ByteWriter) -> None:
        """All fields in order."""
        write_steps(writer, self.steps)
        writer.u8(self.coarse_log2)
        write_levels(writer, self.levels)
        writer.u8(self.thin_octaves)
        writer.u8(mask_of(self.alternating))

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> IntraSteps:
        """Refuses values out of range, and attributes that the sequence does not have."""
        attributes = coded_attributes(sequence.sh_degree)
        steps = read_steps(reader, attributes)
        coarse_log2 = read_bounded(reader.u8, MAX_COARSE_LOG2, "coarse_log2", reader)
        levels = read_levels(reader, attributes)
        offset = reader.offset
        thin_octaves = read_bounded(reader.u8, MAX_THIN_OCTAVES, "thin_octaves", reader)
        if thin_octaves and sequence.unit_exponents.scale > MAX_THIN_EXPONENT:
            raise CorruptBitstream("thin axes on a grid as coarse as octaves", offset=offset)
        alternating = read_mask(reader, attributes[1:], "alternating", "names unknown attributes")
        return IntraSteps(steps, coarse_log2, levels, thin_octaves, frozenset(alternating))


def coded_attributes(sh_degree: int) -> list[Attribute]:
    """Attributes of a frame in coding order."""
    return list(Attribute)[: Attribute.SH_1 + sh_degree]


#: what streams hold that are not an attribute's: places in the output, cover classes, low bits of positions
OUTPUT_ORDER, COVER, POSITION_BITS = "OUTPUT_ORDER", "COVER", "POSITION_BITS"


def intra_streams(sh_degree: int) -> list[str]:
    """What the streams of a coded I-frame, or of births, hold, in their order; a permutation comes second."""
    position, scale, rotation, opacity, *colours = (a.name for a in coded_attributes(sh_degree))
    return [position, COVER, scale, opacity, POSITION_BITS, rotation, *colours]


def read_lengths(reader: ByteReader, streams: list[str]) -> dict[str, int]:
    """Bytes of each of the streams that follow a header."""
    return {name: reader.uvarint() for name in streams}


@dataclass(frozen=True)
class IntraHeader:
    """Header of an INTRA_FRAME payload (spec section 5)."""

    frame_hash: bytes
    kind: IntraKind
    num_gaussians: int
    has_permutation: bool
    control: ControlHeader
    sort_grid: SortGrid | None
    steps: IntraSteps | None
    has_escapes: bool = False

    @staticmethod
    def empty(frame_hash: bytes) -> IntraHeader:
        """That of a frame without Gaussians."""
        return IntraHeader(frame_hash, IntraKind.CODED, 0, False, NO_CONTROL, None, None)

    def with_escapes(self) -> IntraHeader:
        """That of the frame with an ESCAPES chunk."""
        return replace(self, has_escapes=True)

    def streams(self, sh_degree: int) -> list[str]:
        """What its streams hold, in their order."""
        if not self.num_gaussians:
            return []
        names = [a.name for a in coded_attributes(sh_degree)]
        if self.kind == IntraKind.CODED:
            names = intra_streams(sh_degree)
        if self.has_permutation:
            names.insert(1, OUTPUT_ORDER)
        return names

    def write(self, writer: ByteWriter) -> None:
        """All fields in order; grid and steps for `coded` frames only."""
        writer.raw(self.frame_hash)
        writer.u8(self.kind)
        writer.uvarint(self.num_gaussians)
        if not self.num_gaussians:
            return
        writer.u8(int(self.has_permutation))
        writer.u8(int(self.has_escapes))
        self.control.write(writer)
        if self.sort_grid is not None and self.steps is not None:
            self.sort_grid.write(writer)
            self.steps.write(writer)

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> IntraHeader:
        """Refuses N and control points above the level, and escapes where all values are exact."""
        frame_hash = reader.raw(FRAME_HASH_BYTES)
        kind = read_enum(IntraKind, reader, "intra_kind")
        n = read_bounded(reader.uvarint, sequence.limits.max_gaussians, "num_gaussians", reader)
        if n == 0:
            return IntraHeader.empty(frame_hash)
        permuted = read_flag(reader, "has_permutation")
        offset = reader.offset
        has_escapes = read_flag(reader, "has_escapes")
        if has_escapes and kind == IntraKind.PLY:
            raise CorruptBitstream("escapes in a verbatim I-frame", offset=offset)
        offset = reader.offset
        control = ControlHeader.read(reader)
        wanted = min(n // control.spacing, MAX_CONTROL_POINTS)
        at_most(wanted, sequence.limits.max_control_points, "control points", offset)
        grid, steps = None, None
        if kind == IntraKind.CODED:
            grid, steps = SortGrid.read(reader), IntraSteps.read(reader, sequence)
        return IntraHeader(frame_hash, kind, n, permuted, control, grid, steps, has_escapes)


@dataclass(frozen=True)
class InterHeader:
    """Payload of an INTER_FRAME chunk; without tools and steps the frame repeats its reference.

    `visibility`: with that tool the weight of each attribute that has steps at which they are as given,
    sixteenths of an octave.
    """

    frame_hash: bytes
    tools: frozenset[Tool]
    steps: dict[Attribute, int]
    visibility: dict[Attribute, int] = field(default_factory=dict)

    @property
    def changes(self) -> bool:
        """Whether the frame is another than its reference."""
        return bool(self.tools or self.steps)

    @property
    def has_escapes(self) -> bool:
        """Whether an ESCAPES chunk follows."""
        return Tool.ESCAPE in self.tools

    def with_escapes(self) -> InterHeader:
        """That of the frame with an ESCAPES chunk."""
        return replace(self, tools=self.tools | {Tool.ESCAPE})

    def streams(self, sh_degree: int) -> list[str]:
        """It has none."""
        return []

    def write(self, writer: ByteWriter) -> None:
        """Hash, tools and attribute mask; steps; levels."""
        writer.raw(self.frame_hash)
        writer.u8(mask_of(self.tools))
        writer.u8(mask_of(self.steps))
        write_steps(writer, self.steps)
        write_levels(writer, self.visibility)

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> InterHeader:
        """Refuses tools that are unknown and attributes that the sequence does not have."""
        frame_hash = reader.raw(FRAME_HASH_BYTES)
        tools = frozenset(read_mask(reader, Tool, "tools", "need a newer decoder", UnsupportedBitstream))
        offset, attributes = reader.offset, coded_attributes(sequence.sh_degree)
        present = read_mask(reader, attributes, "attribute_mask", "names unknown attributes")
        if not present and Tool.VISIBILITY in tools:
            raise CorruptBitstream("VISIBILITY without attributes", offset=offset)
        if tools - PROFILE_TOOLS[sequence.profile] or (present and sequence.profile == Profile.PAPER):
            name = sequence.profile.name
            raise CorruptBitstream(f"tools or attributes that profile {name} does not have", offset=offset)
        steps = read_steps(reader, present)
        visibility = read_levels(reader, present if Tool.VISIBILITY in tools else [])
        return InterHeader(frame_hash, tools, steps, visibility)


@dataclass(frozen=True)
class NoFields:
    """A chunk of streams alone; `names`: what they hold, None: there is one, which fills it."""

    names: list[str] | None

    def streams(self, sh_degree: int) -> list[str] | None:
        """The same."""
        return self.names

    def write(self, writer: ByteWriter) -> None:
        """Nothing."""
