"""Decoding: chunks to frames, with checksums and hashes checked (spec sections 3 to 7)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import BinaryIO

from dfcgs_codec.bitstream.comments import PlyComments
from dfcgs_codec.bitstream.constants import FRAME_CHUNKS, ChunkType, Profile
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.frame.chunk_reader import FrameReader
from dfcgs_codec.codec.frame.core_decoder import CoreDecoder, CoreFrame, disagreement
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.limits import Budget, DecoderLimits
from dfcgs_codec.codec.frame.walk import code_escapes, code_inter_frame, code_intra_frame
from dfcgs_codec.codec.paper.walk import code_latent_frame
from dfcgs_codec.codec.state.planes import FrameState, output
from dfcgs_codec.core.engine import CORE, NUMPY, wants_core
from dfcgs_codec.errors import BitstreamError, CorruptBitstream, ModelMismatch
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.model.registry import model_of_stream


def _model_of(sequence: SequenceHeader) -> LatentModel | ContextModel:
    """The model that the sequence needs; ModelMismatch where another is installed, or none."""
    model = model_of_stream(sequence.model_id, sequence.model_hash)
    wanted = ContextModel if sequence.profile == Profile.MAIN else LatentModel
    if not isinstance(model, wanted):
        raise ModelMismatch(f"model {sequence.model_id!r} is not one of profile {sequence.profile.name}")
    return model


@dataclass(frozen=True)
class DecodedFrame:
    """One decoded frame: its place in the sequence, the number in its file name, what it decoded to.

    `comments`: those of the input's PLY files that the sequence keeps, as they were.
    """

    index: int
    number: int
    decoded: FrameState | CoreFrame
    sequence: SequenceHeader
    comments: tuple[bytes, ...] = ()

    @property
    def state(self) -> FrameState:
        """The integers of the frame."""
        return self.decoded.state if isinstance(self.decoded, CoreFrame) else self.decoded

    def cloud(self) -> GaussianCloud:
        """The frame's float32 values, in output order."""
        if isinstance(self.decoded, CoreFrame):
            return self.decoded.cloud()
        return output(self.decoded, self.sequence.unit_exponents)


class SequenceDecoder:
    """Decodes a `.dgs` file; needs the file alone; refuses what exceeds `limits` with ResourceLimit.

    `engine`: "core" or "numpy"; by default that of the environment, or the core where it can run.
    """

    def __init__(
        self,
        file: BinaryIO,
        *,
        check: bool = True,
        limits: DecoderLimits | None = None,
        engine: str | None = None,
    ) -> None:
        self.container = ContainerReader(file)
        self.sequence = self.container.sequence
        self._check = check
        self._numbers = self.sequence.frame_numbers.expand()
        self._model = _model_of(self.sequence)
        attributes = coded_attributes(self.sequence.sh_degree)
        self._budget = Budget(limits or DecoderLimits(), attributes)
        self._core = None
        if isinstance(self._model, ContextModel) and wants_core(engine):
            self._core = CoreDecoder.of(self.container, self._model, limits or DecoderLimits(), check=check)

    @property
    def engine(self) -> str:
        """What decodes: files of profile `paper`, and models that the core cannot hold, are numpy's."""
        return NUMPY if self._core is None else CORE

    @cached_property
    def comments(self) -> tuple[bytes, ...]:
        """Comments of the input's PLY files that the file keeps, without the word, as they were."""
        found: list[bytes] = []
        # what is damaged here is told where frames are decoded
        with suppress(BitstreamError):
            for head in self.container.chunks():
                if not head.is_ancillary:
                    break
                if head.chunk_type == ChunkType.PLY_COMMENTS:
                    found += PlyComments.read(self.container.payload(head)).lines
        return tuple(found)

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[DecodedFrame]:
        """Frames start..stop - 1 as far as there are, decoding from the GoF that holds `start`."""
        stop = self.sequence.num_frames if stop is None else min(stop, self.sequence.num_frames)
        if start < 0 or stop < 0:
            raise ValueError(f"frames {start}:{stop}: frames are counted from 0")
        if start >= stop:
            return
        expected, offset = 0, None
        if start > 0 or stop < self.sequence.num_frames:
            entry = [e for e in self.container.index().entries if e.first_frame <= start][-1]
            expected, offset = entry.first_frame, entry.offset
        for frame in self.gof_frames(self.container.chunks(offset)):
            if frame.index != expected:
                raise CorruptBitstream(f"frame {expected} is missing")
            expected = frame.index + 1
            if frame.index >= start:
                yield frame
            if expected == stop and stop < self.sequence.num_frames:
                return
        if expected != self.sequence.num_frames:
            raise CorruptBitstream("fewer frames than the header says")

    def gof_frames(self, chunks: Iterator[ChunkHead]) -> Iterator[DecodedFrame]:
        """The frames whose chunks are given, beginning with an I-frame."""
        state: GofState | CoreFrame | None = None
        for head in chunks:
            if head.chunk_type not in (ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME):
                self._side_chunk(head)
                continue
            index = head.frame_index
            if index >= self.sequence.num_frames:
                raise CorruptBitstream("more frames than the header says", offset=head.offset)
            if head.chunk_type == ChunkType.INTRA_FRAME:
                # what the GoF before it left behind is not needed any more
                state = None
            elif state is None:
                raise CorruptBitstream("a P-frame without an I-frame before it", offset=head.offset)
            decoded: FrameState | CoreFrame
            if self._core is not None:
                state = decoded = self._core.frame(head, chunks)
            else:
                assert not isinstance(state, CoreFrame)
                state = self._decoded(head, chunks, state)
                decoded = state.frame
            yield DecodedFrame(index, self._numbers[index], decoded, self.sequence, self.comments)

    def _decoded(self, head: ChunkHead, chunks: Iterator[ChunkHead], before: GofState | None) -> GofState:
        """After the frame that begins with `head`: an I-frame, or a P-frame that follows `before`."""
        model = self._model if isinstance(self._model, ContextModel) else None
        frame = FrameReader(self.container, head, chunks, model, self._budget)
        if before is None:
            state = code_intra_frame(frame, None)
        elif isinstance(self._model, LatentModel):
            state = code_latent_frame(frame, before, self._model)
        else:
            state, _ = code_inter_frame(frame, None, before)
        if frame.header.has_escapes:
            state = code_escapes(frame, None, state)
        if self._check and state.frame.hash() != frame.header.frame_hash:
            raise disagreement(head)
        return state

    def _side_chunk(self, head: ChunkHead) -> None:
        if head.chunk_type in FRAME_CHUNKS or head.chunk_type == ChunkType.SEQUENCE_HEADER:
            raise CorruptBitstream("a chunk stands where it may not", offset=head.offset)
        self.container.payload(head)
