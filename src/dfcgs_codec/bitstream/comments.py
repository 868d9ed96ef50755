"""Comments of PLY files that a file keeps (spec section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.io import ByteReader, ByteWriter

_NEWLINES = bytes.maketrans(b"\r\n", b"  ")


@dataclass(frozen=True)
class PlyComments:
    """Payload of a PLY_COMMENTS chunk: what stands behind the word `comment` in each line, as it was."""

    lines: tuple[bytes, ...]

    def write(self, writer: ByteWriter) -> None:
        """The lines, joined by newlines."""
        writer.raw(b"\n".join(line.translate(_NEWLINES) for line in self.lines))

    @staticmethod
    def read(reader: ByteReader) -> PlyComments:
        """All of the payload; carriage returns become spaces, so that no line can end a header."""
        lines = reader.raw(reader.remaining).split(b"\n")
        return PlyComments(tuple(line.translate(_NEWLINES) for line in lines))
