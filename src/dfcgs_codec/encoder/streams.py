"""The streams of a payload being written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dfcgs_codec.encoder.symbol_writer import SymbolWriter


class Streams:
    """Collects the streams of a payload; `preferred`: the way of each that can be walked in two."""

    def __init__(self, preferred: Sequence[bool | None] = ()) -> None:
        self._writers: list[SymbolWriter] = []
        self._given: Iterator[bool | None] = iter(preferred)

    def next(self) -> SymbolWriter:
        """A writer for the next stream."""
        self._writers.append(SymbolWriter(next(self._given, None)))
        return self._writers[-1]

    @property
    def preferred(self) -> list[bool | None]:
        """The way that each stream was walked."""
        return [writer.preferred for writer in self._writers]

    def finish(self) -> list[bytes]:
        """All streams."""
        return [writer.getvalue() for writer in self._writers]
