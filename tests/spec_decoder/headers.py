"""Chapters 3 to 6: chunks and their headers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import (
    COLUMNS,
    MAIN,
    OPACITY,
    PAPER,
    POSITION,
    ROTATION,
    SCALE,
    SH_DC,
    STATE_LIMIT,
    Fields,
    require,
)
from tests.spec_decoder.columns import column
from tests.spec_decoder.gathering import ControlHeader
from tests.spec_decoder.gof import Gof
from tests.spec_decoder.intra import IntraHeader, coded_intra
from tests.spec_decoder.lods import Lods
from tests.spec_decoder.positions import SortGrid
from tests.spec_decoder.stream import open_streams
from tests.spec_decoder.topology import Topology
from tests.spec_decoder.verbatim import verbatim_intra

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Row


@dataclass
class Sequence:
    sh_degree: int
    num_frames: int
    frame_numbers: Row
    exponents: dict[int, int]
    profile: int = MAIN
    model_id: str = ""
    model_hash: bytes = b""
    origin: Row = field(default_factory=lambda: [0, 0, 0])
    is_double: bool = False
    level: int = 3

    @property
    def attributes(self) -> Row:
        return list(range(SH_DC + 1 + self.sh_degree))


def sequence_header(fields: Fields) -> Sequence:
    version, profile, level, sh_degree, order = (fields.u8() for _ in range(5))
    require(
        version == 11 and profile in (MAIN, PAPER) and level in (1, 2, 3) and sh_degree <= 3 and order <= 2
    )
    num_frames = fields.uvarint()
    fields.uvarint()
    require(num_frames > 0 and fields.uvarint() > 0)
    numbers: Row = []
    end = 0
    for _ in range(fields.uvarint()):
        first = end + fields.uvarint()
        end = first + fields.uvarint() + 1
        numbers += range(first, end)
    require(len(numbers) == num_frames)
    position, scale, opacity, color = (fields.svarint() for _ in range(4))
    origin = [fields.svarint() for _ in range(3)]
    precision = fields.u8()
    require(all(abs(o) <= 1 << 52 for o in origin) and precision <= 1)
    model_id = fields.raw(fields.uvarint())
    require(len(model_id) <= 64 and model_id.isascii())
    hashed = fields.raw(8)
    require(fields.place == len(fields.data))
    exponents = {POSITION: position, SCALE: scale, ROTATION: -24, OPACITY: opacity, SH_DC: color}
    found = Sequence(sh_degree, num_frames, numbers, exponents, profile, model_id.decode("ascii"), hashed)
    return replace(found, origin=origin, is_double=precision == 1, level=level)


def chunks(data: bytes) -> Iterator[tuple[int, int, Fields]]:
    """Type, frame index and payload of each chunk."""
    require(data[:8] == bytes.fromhex("894447530d0a1a0a"))
    fields = Fields(data)
    fields.place = 8
    kind = 0
    while kind != 0x7F:
        start = fields.place
        kind, frame_index, length = fields.u8(), fields.uvarint(), fields.uvarint()
        payload = fields.raw(length)
        crc = zlib.crc32(data[start : fields.place])
        require(fields.raw(4) == struct.pack("<I", crc))
        if kind in (0x01, 0x10, 0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x7E, 0x7F):
            yield kind, frame_index, Fields(payload)
        else:
            require(kind & 0x80 != 0)
    require(fields.place == len(data))


def sort_grid(fields: Fields) -> SortGrid:
    shift, bits = fields.u8(), fields.u8()
    origin = [fields.svarint() for _ in range(3)]
    return SortGrid(shift, bits, origin, bool(fields.u8()))


def intra_header(fields: Fields, sequence: Sequence) -> IntraHeader:
    """5, from `sort_shift` to `alternating`."""
    grid = sort_grid(fields)
    steps = {attribute: fields.uvarint() for attribute in sequence.attributes}
    require(all(1 <= step <= STATE_LIMIT for step in steps.values()))
    coarse_log2 = fields.u8()
    levels = {attribute: fields.svarint() for attribute in sequence.attributes}
    require(coarse_log2 <= 8 and all(abs(level) <= STATE_LIMIT for level in levels.values()))
    thin_octaves = fields.u8()
    require(thin_octaves <= 8 and (not thin_octaves or sequence.exponents[SCALE] <= -11))
    alternating = fields.u8()
    require(alternating & ~sum(1 << a for a in sequence.attributes if a != POSITION) == 0)
    return IntraHeader(grid, steps, coarse_log2, levels, thin_octaves, alternating)


def intra_frame(fields: Fields, sequence: Sequence) -> tuple[bytes, Gof | None, bool]:
    """Hash, the GoF that begins, and whether escapes follow; None for a frame without Gaussians."""
    frame_hash, kind = fields.raw(16), fields.u8()
    n = fields.uvarint()
    if n == 0:
        require(kind == 1 and fields.place == len(fields.data))
        return frame_hash, None, False
    has_permutation, has_escapes = bool(fields.u8()), fields.u8()
    require(has_escapes <= (1 if kind == 1 else 0))
    control = ControlHeader(fields.uvarint(), fields.u8())
    require(control.spacing >= 1 and control.shift <= 31)
    require(min(n // control.spacing, 16384) <= (4096 if sequence.level == 1 else 16384))
    coding = (sequence.exponents, has_permutation)
    if kind == 1:
        header = intra_header(fields, sequence)
        streams = open_streams(fields, header.num_streams + has_permutation)
        gof = Gof(*coded_intra(streams, n, header, coding), header.steps[POSITION], control)
    else:
        require(kind == 0)
        streams = open_streams(fields, len(sequence.attributes) + has_permutation)
        state = verbatim_intra(streams, n, sequence, has_permutation)
        gof = Gof(state, state.positions, [0] * n, 1, control)
    require(next(streams, None) is None)
    return frame_hash, gof, bool(has_escapes)


def check_escapes(fields: Fields, sequence: Sequence, n: int) -> bytes:
    """6.5: the payload, where it is as it should be and not without escapes."""
    escapes = list(read_escapes(Fields(fields.data), sequence))
    places = [(row, column) for row, column, _ in escapes]
    require(places == sorted(set(places)) and all(row < n for row, _ in places))
    require(all(column < sum(COLUMNS[a] for a in sequence.attributes) for _, column in places))
    return fields.data if escapes else b""


def read_escapes(fields: Fields, sequence: Sequence) -> Iterator[tuple[int, int, float]]:
    count = fields.uvarint()
    require(6 * count <= len(fields.data))
    rows: Row = []
    for _ in range(count):
        rows.append((rows[-1] if rows else 0) + fields.uvarint())
    columns = [fields.u8() for _ in range(count)]
    for row, c in zip(rows, columns, strict=True):
        is_double = c < 3 and sequence.is_double
        value: float = struct.unpack("<d" if is_double else "<f", fields.raw(8 if is_double else 4))[0]
        yield row, c, value
    require(fields.place == len(fields.data))


def topology_chunk(fields: Fields, sequence: Sequence, n: int) -> Topology:
    """6.2, 15.1."""
    num_removals, has_permutation, num_births = fields.uvarint(), fields.u8(), fields.uvarint()
    require(num_removals < n and has_permutation <= 1)
    header = intra_header(fields, sequence) if num_births else None
    num_streams = header.num_streams if header else 0
    streams = open_streams(fields, (num_removals > 0) + num_streams + has_permutation)
    removed, births, places = [0] * n, None, None
    if num_removals:
        stream = next(streams)
        removed = stream.grouped([0] * n, stream.read_histograms([0], 2))
        require(sum(removed) == num_removals)
    if header:
        births = coded_intra(streams, num_births, header, (sequence.exponents, False))
    if has_permutation:
        places, _ = column(next(streams), Lods(n - num_removals + num_births), [], [])
    require(next(streams, None) is None)
    return Topology([i for i in range(n) if not removed[i]], births, places)
