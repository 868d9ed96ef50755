"""Long arrays are worked through in pieces: what is found on the way then stays in the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator

#: rows of a piece
_ROWS = 8192


def pieces(count: int) -> Iterator[slice]:
    """Slices of at most 8192 of `count` rows, in order."""
    for start in range(0, count, _ROWS):
        yield slice(start, min(start + _ROWS, count))
