"""The chunks of a frame, read or written: what `SymbolCoder` is for symbols (spec section 3).

`FrameReader` is one direction, `FrameWriter` of the encoder the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.model.context_model import ContextModel


class ChunkHeader(Protocol):
    """The fields of a chunk, in front of its streams."""

    def write(self, writer: ByteWriter) -> None:
        """All fields in order."""

    def streams(self, sh_degree: int) -> list[str] | None:
        """What its streams hold, in their order; None: there is one, which fills the rest."""


Header = TypeVar("Header", bound=ChunkHeader)


class ChunkCoder(Protocol[Header]):
    """A chunk: its header, then its streams one after the other."""

    header: Header

    def next(self) -> SymbolCoder:
        """The coder of the next stream; a reader checks that the one before was used up."""

    def close(self) -> None:
        """There are no more streams."""


class FrameCoder(Protocol):
    """The chunks of one frame."""

    @property
    def sequence(self) -> SequenceHeader:
        """That of the file."""

    @property
    def model(self) -> ContextModel | None:
        """The frozen prior, where the profile has one."""

    def chunk(
        self,
        kind: ChunkType,
        read: Callable[[ByteReader, SequenceHeader], Header],
        given: Header | None,
    ) -> ChunkCoder[Header]:
        """The next chunk; a reader gets its header by `read`, a writer writes the one `given`."""
