"""The walk of a P-frame of profile `paper`, for reading and writing (spec annex B)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import ChunkType, Tool
from dfcgs_codec.bitstream.frame_headers import NoFields
from dfcgs_codec.bitstream.motion_header import LatentHeader
from dfcgs_codec.codec.frame.chunks import FrameCoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.walk import code_inter_header
from dfcgs_codec.codec.paper.latent_motion import LatentReference, code_hyper, code_latents
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.model.latent_model import LATENT_BITS, LatentModel, latents_of


@dataclass(frozen=True)
class LatentGoal:
    """What an encoder wants of motion: latents y (n, 16), and z (n, 16) where there is a hyperprior."""

    header: LatentHeader
    latents: Int64
    hyper: Int64 | None

    def symbols(self, mean: Int64) -> Int64:
        """Those of the latents, whose `mean` is known (n, 16)."""
        bits = LATENT_BITS + self.header.step_log2
        return (self.latents - mean + (1 << (bits - 1))) >> bits


def code_latent_motion(frame: FrameCoder, goal: LatentGoal | None, reference: LatentReference) -> FrameState:
    """The HYPERPRIOR chunk, where the model has one, and MOTION; the frame that they lead to."""
    model, rows = reference.model, reference.rows
    hyper = None
    if model.has_hyperprior:
        alone = NoFields(None)
        side = frame.chunk(ChunkType.HYPERPRIOR, lambda *_: alone, alone)
        hyper = code_hyper(side.next(), None if goal is None else goal.hyper, model, len(rows))
        side.close()
    chunk = frame.chunk(ChunkType.MOTION, LatentHeader.read, None if goal is None else goal.header)
    header = chunk.header
    if header.num_coded != len(rows):
        raise CorruptBitstream(f"{header.num_coded} control points have latents")
    mean, indices = model.distribution(hyper, reference.prior(rows), header.step_log2)
    symbols = code_latents(chunk.next(), None if goal is None else goal.symbols(mean), indices)
    chunk.close()
    return reference.moved(header, latents_of(symbols, mean, header.step_log2))


def code_latent_frame(frame: FrameCoder, before: GofState, model: LatentModel) -> GofState:
    """All chunks of a P-frame, read."""
    header = code_inter_header(frame, None, before)
    reference = LatentReference(model, before, frame.sequence.unit_exponents)
    state = before.frame
    if Tool.LATENT in header.tools:
        state = code_latent_motion(frame, None, reference)
    if Tool.REFINEMENT in header.tools:
        if not model.has_refinement:
            raise CorruptBitstream("REFINEMENT by a model without it")
        state = reference.refined(state)
    return before.after(state.on_grid() if header.changes else state, InterSymbols(), None)
