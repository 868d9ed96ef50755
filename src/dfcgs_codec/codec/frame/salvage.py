"""Getting what can be had out of a damaged file: every frame up to the damage in each GoF."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

from dfcgs_codec.codec.frame.chunk_search import ChunkSearch, FoundGof
from dfcgs_codec.codec.frame.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.codec.frame.limits import DecoderLimits
from dfcgs_codec.errors import BitstreamError, DfcgsError, ResourceLimit, VerificationError


class _Losses:
    """Tells which frames were lost, and why, into a list of lines."""

    def __init__(self, lines: list[str], num_frames: int) -> None:
        self._lines, self._num_frames = lines, num_frames
        self.expected = 0

    def until(self, index: int, error: DfcgsError | None) -> None:
        """Frame `index` is the next one that is there; `error`: what happened to those before it."""
        last = index - 1
        if last >= self.expected:
            which = f"frame {last}" if last == self.expected else f"frames {self.expected} to {last}"
            self._lines.append(f"{which}: {error or 'not in the file'}")
        self.expected = index + 1

    def rest(self, error: DfcgsError | None) -> None:
        """There are no frames any more."""
        if self.expected < self._num_frames:
            self.until(self._num_frames, error)
        elif error is not None and not self._lines:
            self._lines.append(f"no frame, but: {error}")


def _whole_frames(decoder: SequenceDecoder, gof: FoundGof) -> Iterator[DecodedFrame | DfcgsError]:
    """Frames of a GoF, one after the other; then the error that ended it, if one did."""
    expected = gof.chunks[0].frame_index
    try:
        for frame in decoder.gof_frames(iter(gof.chunks)):
            if frame.index != expected:
                break
            expected += 1
            yield frame
    except ResourceLimit:
        raise
    except (BitstreamError, VerificationError) as error:
        # chunks that are missing are missing because of the damage
        yield gof.error or error
        return
    if gof.error is not None:
        yield gof.error


def salvage(
    file: BinaryIO, losses: list[str], limits: DecoderLimits | None = None, engine: str | None = None
) -> Iterator[DecodedFrame]:
    """All frames whose chunks, and those of their references, are whole and whose hashes are right.

    What is lost is described in `losses`. The sequence header must be whole: its error is raised, and so is
    ResourceLimit. `engine`: see SequenceDecoder.
    """
    decoder = SequenceDecoder(file, limits=limits, engine=engine)
    search = ChunkSearch(decoder.container)
    lost = _Losses(losses, decoder.sequence.num_frames)
    reason: DfcgsError | None = None
    for gof in search.gofs():
        for found in _whole_frames(decoder, gof):
            if isinstance(found, DfcgsError):
                reason = found
            elif found.index >= lost.expected:
                lost.until(found.index, reason or search.error)
                reason = None
                yield found
    lost.rest(reason or search.error)
