"""The streams of a payload being written."""

from __future__ import annotations

from dfcgs_codec.encoder.columns.writer import SymbolWriter


class Streams:
    """Collects the streams of a payload."""

    def __init__(self) -> None:
        self._writers: list[SymbolWriter] = []

    def next(self) -> SymbolWriter:
        """A writer for the next stream."""
        self._writers.append(SymbolWriter())
        return self._writers[-1]

    def finish(self) -> list[bytes]:
        """All streams."""
        return [writer.getvalue() for writer in self._writers]
