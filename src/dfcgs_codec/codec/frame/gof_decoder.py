"""Decoding the frames of a GoF, one after the other (spec sections 5, 6 and 9.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, ChunkType, IntraKind, Tool
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.fields import at_most
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, coded_attributes
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.motion_header import LatentHeader, MotionHeader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.frame.gof_state import GofSetup, GofState
from dfcgs_codec.codec.frame.limits import Budget, FrameCharge
from dfcgs_codec.codec.frame.reconstruct import reconstruct_inter
from dfcgs_codec.codec.frame.topology import code_places, code_topology
from dfcgs_codec.codec.intra.verbatim import cloud_of_columns, code_verbatim, state_of
from dfcgs_codec.codec.intra.walk import IntraShape, code_intra
from dfcgs_codec.codec.motion.compensation import Carried
from dfcgs_codec.codec.motion.walk import NUM_MOTION_STREAMS, MotionSymbols, code_motion
from dfcgs_codec.codec.paper.latent_motion import LatentReference, code_hyper, code_latents
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.residual.walk import InterShape, code_inter
from dfcgs_codec.codec.state.planes import FrameState, Plane, empty_state
from dfcgs_codec.errors import CorruptBitstream, VerificationError
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.latent_model import LatentModel, latents_of


class _Streams:
    """Opens the streams of a payload one after the other and checks that each was used up.

    `charge` is told the number of symbols of each.
    """

    def __init__(
        self, reader: ByteReader, lengths: tuple[int, ...], charge: Callable[[int], None] | None = None
    ) -> None:
        self._reader, self._charge = reader, charge
        self._lengths = iter(lengths)
        self._open: SymbolReader | None = None
        if sum(lengths) != reader.remaining:
            raise CorruptBitstream("stream lengths do not fill the payload", offset=reader.offset)

    @staticmethod
    def only(reader: ByteReader) -> SymbolReader:
        """The coder of the stream that fills the rest of a payload."""
        offset = reader.offset
        return SymbolReader(reader.raw(reader.remaining), offset)

    def next(self) -> SymbolReader:
        """The next stream's coder."""
        self.close()
        offset = self._reader.offset
        self._open = SymbolReader(self._reader.raw(next(self._lengths)), offset)
        return self._open

    def close(self) -> None:
        """Check the open stream."""
        if self._open is not None:
            self._open.finish()
            if self._charge is not None:
                self._charge(self._open.num_symbols)


def decode_intra(reader: ByteReader, header: IntraHeader, sequence: SequenceHeader) -> FrameState:
    """State of an I-frame; `reader` stands behind the header."""
    attributes = coded_attributes(sequence.sh_degree)
    streams = _Streams(reader, header.lengths)
    if not header.num_gaussians:
        return empty_state(attributes)
    if header.kind == IntraKind.PLY:
        widths = [STATE_COLUMNS[a] for a in attributes]
        verbatim = code_verbatim(streams.next, None, widths, (header.num_gaussians, header.has_permutation))
        streams.close()
        state = state_of(cloud_of_columns(verbatim.columns), sequence.unit_exponents)
        order = None if verbatim.permutation is None else Plane(verbatim.permutation[:, None])
        return FrameState(state.planes, order, state.verbatim)
    assert header.sort_grid is not None
    assert header.steps is not None
    shape = IntraShape(
        header.num_gaussians,
        header.has_permutation,
        header.sort_grid,
        header.steps,
        sequence.unit_exponents,
    )
    state = code_intra(streams.next, None, shape)
    streams.close()
    return state


class GofDecoder:
    """Decodes the frames of GoFs in turn; holds what they leave behind; `budget` is charged for them."""

    def __init__(
        self,
        container: ContainerReader,
        check: bool,
        model: LatentModel | ContextModel,
        budget: Budget,
    ) -> None:
        self._budget = budget
        self._latents = model if isinstance(model, LatentModel) else None
        self._prior = model if isinstance(model, ContextModel) else None
        self._container = container
        self._sequence = container.sequence
        self._check = check
        self._state: GofState | None = None

    def intra(self, head: ChunkHead, next_chunk: Callable[[], ChunkHead]) -> FrameState:
        """Decode an INTRA_FRAME chunk and the escapes that it announces."""
        # what the GoF before it left behind is not needed any more
        self._state = None
        reader = self._payload(head)
        header = IntraHeader.read(reader, self._sequence)
        self._budget.intra(head.frame_index, header.num_gaussians, header.control)
        frame = decode_intra(reader, header, self._sequence)
        setup = GofSetup(header.control, self._sequence.unit_exponents, self._prior)
        state = GofState.of_intra(frame, setup, header.steps)
        if header.has_escapes:
            state = self._escaped(head, state, next_chunk)
        return self._keep(state, header.frame_hash, head)

    def inter(self, head: ChunkHead, next_chunk: Callable[[], ChunkHead]) -> FrameState:
        """Decode an INTER_FRAME chunk and the chunks that belong to it."""
        state = self._state
        if state is None:
            raise CorruptBitstream("a P-frame without an I-frame before it", offset=head.offset)
        reader = self._payload(head)
        header = InterHeader.read(reader, self._sequence)
        reader.expect_end("the P-frame header")
        self._budget.inter(head.frame_index, state.frame.num_gaussians, header)
        changes = bool(header.tools or header.steps)
        if changes and not state.frame.num_gaussians:
            raise CorruptBitstream("a P-frame that changes a frame without Gaussians", offset=head.offset)
        if changes:
            state = replace(state, frame=state.frame.on_grid())
        if self._latents is not None:
            state = self._latent(head, header, state, next_chunk)
        else:
            state = self._main(head, header, state, next_chunk)
        if Tool.ESCAPE in header.tools:
            state = self._escaped(head, state, next_chunk)
        return self._keep(state, header.frame_hash, head)

    def _latent(
        self, head: ChunkHead, header: InterHeader, state: GofState, next_chunk: Callable[[], ChunkHead]
    ) -> GofState:
        """The state after a P-frame of profile PAPER."""
        assert self._latents is not None
        reference = LatentReference(self._latents, state, self._sequence.unit_exponents)
        frame = state.frame
        if Tool.LATENT in header.tools:
            charge = FrameCharge(self._budget, head.frame_index, frame.num_gaussians)
            charge.latents(len(reference.rows))
            hyper = None
            if self._latents.has_hyperprior:
                chunk = self._open(head, next_chunk(), ChunkType.HYPERPRIOR)
                coder, count = _Streams.only(chunk), len(reference.rows)
                hyper = code_hyper(coder, None, self._latents, count)
                coder.finish()
            chunk = self._open(head, next_chunk(), ChunkType.MOTION)
            offset, latent = chunk.offset, LatentHeader.read(chunk)
            if latent.num_coded != len(reference.rows):
                raise CorruptBitstream(f"{latent.num_coded} control points have latents", offset=offset)
            charge.spread(latent.num_coded, latent.spread)
            coder = _Streams.only(chunk)
            mean, indices = self._latents.distribution(
                hyper, reference.prior(reference.rows), latent.step_log2
            )
            symbols = code_latents(coder, None, indices)
            coder.finish()
            frame = reference.moved(latent, latents_of(symbols, mean, latent.step_log2))
        if Tool.REFINEMENT in header.tools:
            if not self._latents.has_refinement:
                raise CorruptBitstream("REFINEMENT by a model without it", offset=head.offset)
            frame = reference.refined(frame)
        return state.after(frame, InterSymbols(), None)

    def _main(
        self, head: ChunkHead, header: InterHeader, state: GofState, next_chunk: Callable[[], ChunkHead]
    ) -> GofState:
        """The state after a P-frame of profile MAIN."""
        charge = FrameCharge(self._budget, head.frame_index, state.frame.num_gaussians)
        topology = None
        if Tool.TOPOLOGY in header.tools:
            chunk = self._open(head, next_chunk(), ChunkType.TOPOLOGY)
            topology = _Topology.read(chunk, self._sequence, charge)
            state = state.survivors(topology.kept)
        carried = None
        if Tool.MOTION in header.tools:
            chunk = self._open(head, next_chunk(), ChunkType.MOTION)
            carried = _read_motion(chunk, state, charge)
        symbols = InterSymbols()
        if header.steps:
            chunk = self._open(head, next_chunk(), ChunkType.RESIDUAL)
            symbols = _read_residual(chunk, state, header, None if carried is None else carried[1], charge)
        predicted = state.frame if carried is None else carried[0].state
        coarser = state.visibility.all_multipliers(header.visibility)
        frame = reconstruct_inter(symbols, header.steps, predicted, coarser)
        state = state.after(frame, symbols, carried)
        if topology is not None:
            state = topology.finish(state)
        return state

    def _escaped(self, head: ChunkHead, state: GofState, next_chunk: Callable[[], ChunkHead]) -> GofState:
        """With the escapes of the frame."""
        chunk = self._open(head, next_chunk(), ChunkType.ESCAPES)
        escapes = Escapes.read(chunk, self._sequence, state.frame.num_gaussians)
        return replace(state, frame=replace(state.frame, escapes=escapes))

    def _open(self, head: ChunkHead, chunk: ChunkHead, kind: ChunkType) -> ByteReader:
        """Payload of a chunk that belongs to the frame of `head`."""
        if chunk.chunk_type != kind or chunk.frame_index != head.frame_index:
            raise CorruptBitstream(f"a frame lacks its {kind.name} chunk", offset=chunk.offset)
        return self._payload(chunk)

    def _payload(self, head: ChunkHead) -> ByteReader:
        self._budget.read(head.end - head.offset)
        return self._container.payload(head)

    def _keep(self, state: GofState, frame_hash: bytes, head: ChunkHead) -> FrameState:
        if self._check and state.frame.hash() != frame_hash:
            raise VerificationError(
                f"frame {head.frame_index} decodes to other values than its encoder had: "
                "please report this file",
                offset=head.offset,
            )
        self._state = state
        return state.frame


@dataclass(frozen=True)
class _Topology:
    """A TOPOLOGY chunk, up to its permutation, which cannot be read before the frame is there."""

    header: TopologyHeader
    kept: Int64
    births: FrameState | None
    streams: _Streams

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader, charge: FrameCharge) -> _Topology:
        offset, num_gaussians = reader.offset, charge.num_gaussians
        header = TopologyHeader.read(reader, sequence)
        at_most(header.num_removals, num_gaussians - 1, "num_removals", offset)
        count = num_gaussians - header.num_removals + header.num_births
        at_most(count, sequence.limits.max_gaussians, "num_gaussians", offset)
        if header.num_births:
            charge.births(header.num_births, count)
        num_streams = header.num_streams(sequence.sh_degree)
        streams = _Streams(reader, tuple(reader.uvarint() for _ in range(num_streams)))
        before = (num_gaussians, sequence.unit_exponents)
        kept, births = code_topology(streams.next, None, header, before)
        return _Topology(header, kept, births, streams)

    def finish(self, state: GofState) -> GofState:
        """Add births and put all in their places."""
        if self.births is not None:
            state = state.with_births(self.births, state.places_of_births(self.births))
        if self.header.has_permutation:
            state = state.in_places(code_places(self.streams.next(), None, state.expected_places()))
        self.streams.close()
        return state


def _read_motion(reader: ByteReader, state: GofState, charge: FrameCharge) -> tuple[Carried, MotionSymbols]:
    motion = state.motion()
    header = MotionHeader.read(reader)
    streams = _Streams(reader, tuple(reader.uvarint() for _ in range(NUM_MOTION_STREAMS)), charge.symbols)
    shape = motion.shape(header, state.model)
    symbols = code_motion(streams.next, None, motion.symbols, shape)
    streams.close()
    return motion.carry(header, symbols, state.frame), symbols


def _read_residual(
    reader: ByteReader,
    state: GofState,
    header: InterHeader,
    moved: MotionSymbols | None,
    charge: FrameCharge,
) -> InterSymbols:
    modes = None if moved is None else moved.modes
    attributes, count = sorted(header.steps), state.frame.num_gaussians
    prior = state.prior(header.visibility, moved)
    shape = InterShape(attributes, count, state.levels, prior, modes)
    streams = _Streams(reader, tuple(reader.uvarint() for _ in attributes), charge.symbols)
    symbols = code_inter(streams.next, None, state.history, shape)
    streams.close()
    return symbols
