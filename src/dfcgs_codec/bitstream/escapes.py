"""Values that the grids of a sequence do not hold, exactly as they are (spec section 6.5)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dfcgs_codec.array_types import Int64, UInt64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, Precision
from dfcgs_codec.bitstream.fields import read_bounded
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.errors import CorruptBitstream

_NUM_POSITIONS = STATE_COLUMNS[Attribute.POSITION]
#: a row, a column and four bytes of a float32 take this many bytes at least
_LEAST_BYTES = 6


def widths(columns: Int64, precision: Precision) -> Int64:
    """Bytes of the value of each of `columns`."""
    wide = (columns < _NUM_POSITIONS) & (precision == Precision.FLOAT64)
    return np.where(wide, 8, 4)


@dataclass(frozen=True, eq=False)
class Escapes:
    """Payload of an ESCAPES chunk: `rows` in GoF order, `columns` of all attributes in a row, bit `patterns`.

    All are of length E, in rising order of row, then column. A pattern is that of a float32, or of a float64
    where positions have that `precision`.
    """

    rows: Int64
    columns: Int64
    patterns: UInt64
    precision: Precision = Precision.FLOAT32

    @staticmethod
    def none() -> Escapes:
        """No escape."""
        return Escapes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.uint64))

    def __len__(self) -> int:
        return len(self.rows)

    def streams(self, sh_degree: int) -> list[str]:
        """It has none."""
        return []

    def write(self, writer: ByteWriter) -> None:
        """Count, rows by their differences, columns, patterns."""
        writer.uvarint(len(self))
        for before, row in pairwise([0, *self.rows.tolist()]):
            writer.uvarint(row - before)
        writer.raw(self.columns.astype(np.uint8).tobytes())
        sizes = widths(self.columns, self.precision).tolist()
        for pattern, size in zip(self.patterns.tolist(), sizes, strict=True):
            writer.raw(pattern.to_bytes(size, "little"))

    def payload(self) -> bytes:
        """All bytes."""
        writer = ByteWriter()
        self.write(writer)
        return writer.getvalue()

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader, num_gaussians: int) -> Escapes:
        """Refuses rows and columns that the frame does not have, and another order than the rising one."""
        offset, precision = reader.offset, sequence.unit_exponents.precision
        most = reader.remaining // _LEAST_BYTES
        count = read_bounded(reader.uvarint, most, "num_escapes", reader)
        rows, row = [], 0
        for _ in range(count):
            row += reader.uvarint()
            if row >= num_gaussians:
                raise CorruptBitstream(f"an escape of Gaussian {row} of {num_gaussians}", offset=offset)
            rows.append(row)
        columns = np.frombuffer(reader.raw(count), np.uint8).astype(np.int64)
        num_columns = sum(STATE_COLUMNS[a] for a in coded_attributes(sequence.sh_degree))
        place = np.array(rows, np.int64) * num_columns + columns
        if count and (columns.max() >= num_columns or (np.diff(place) <= 0).any()):
            raise CorruptBitstream("escapes out of order, or of no attribute", offset=offset)
        sizes = widths(columns, precision).tolist()
        patterns = [int.from_bytes(reader.raw(size), "little") for size in sizes]
        reader.expect_end("the escapes")
        return Escapes(np.array(rows, np.int64), columns, np.array(patterns, np.uint64), precision)
