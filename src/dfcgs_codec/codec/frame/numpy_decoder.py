"""Decoding the frames of a file with numpy: the reference, and what profile `paper` is decoded with."""

from __future__ import annotations

from collections.abc import Iterator

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.codec.frame.chunk_reader import FrameReader
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.limits import Budget
from dfcgs_codec.codec.frame.walk import code_escapes, code_inter_frame, code_intra_frame
from dfcgs_codec.codec.paper.walk import code_latent_frame
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.errors import CorruptBitstream, VerificationError
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.latent_model import LatentModel


class NumpyDecoder:
    """Decodes the frames of GoFs in turn; holds what they leave behind; `budget` is charged for them."""

    def __init__(
        self, container: ContainerReader, model: LatentModel | ContextModel, budget: Budget, *, check: bool
    ) -> None:
        self._container, self._model, self._budget, self._check = container, model, budget, check
        self._state: GofState | None = None

    def forget(self) -> None:
        """What follows begins with an I-frame."""
        self._state = None

    def frame(self, head: ChunkHead, behind: Iterator[ChunkHead]) -> FrameState:
        """The frame that begins with `head`; takes its other chunks from `behind`."""
        model = self._model if isinstance(self._model, ContextModel) else None
        frame = FrameReader(self._container, head, behind, model, self._budget)
        if head.chunk_type == ChunkType.INTRA_FRAME:
            # what the GoF before it left behind is not needed any more
            self._state = None
            state = code_intra_frame(frame, None)
        elif self._state is None:
            raise CorruptBitstream("a P-frame without an I-frame before it", offset=head.offset)
        elif isinstance(self._model, LatentModel):
            state = code_latent_frame(frame, self._state, self._model)
        else:
            state, _ = code_inter_frame(frame, None, self._state)
        if frame.header.has_escapes:
            state = code_escapes(frame, None, state)
        if self._check and state.frame.hash() != frame.header.frame_hash:
            raise disagreement(head)
        self._state = state
        return state.frame


def disagreement(head: ChunkHead) -> VerificationError:
    """The error of a frame whose hash is not that of the file."""
    return VerificationError(
        f"frame {head.frame_index} decodes to other values than its encoder had: please report this file",
        offset=head.offset,
    )
