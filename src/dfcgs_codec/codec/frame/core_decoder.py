"""Decoding the frames of a file with the C core, chunk by chunk."""

from __future__ import annotations

import weakref
from collections.abc import Iterator

import numpy as np

from dfcgs_codec.array_types import Floats
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, Precision
from dfcgs_codec.bitstream.container import ChunkHead, ContainerReader
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.codec.frame.chunk_reader import missing_part
from dfcgs_codec.codec.frame.limits import DecoderLimits, too_large, too_many, unpaid_memory, unpaid_work
from dfcgs_codec.codec.intra.verbatim import cloud_of_columns
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from dfcgs_codec.core.module import Instance, Record
from dfcgs_codec.errors import (
    BitstreamError,
    CorruptBitstream,
    DfcgsError,
    LimitExceeded,
    ModelMismatch,
    ResourceLimit,
    TruncatedBitstream,
    UnsupportedBitstream,
    VerificationError,
)
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.core_words import words_of

#: dfcgs_status of core/core.h
_ERRORS: dict[int, type[BitstreamError]] = {
    1: CorruptBitstream,
    2: TruncatedBitstream,
    3: UnsupportedBitstream,
    4: LimitExceeded,
    5: ModelMismatch,
}
_HASH, _MEMORY, _RESOURCES = 6, 7, 8
#: bit of `touched` for the order of the output, behind those of the planes
_ORDER_BIT = 8
_FLOATS = np.dtype("<f4")
#: arrays of a GaussianCloud, and the bits of `touched` that change them
_ARRAYS = {
    "positions": 1 << Attribute.POSITION,
    "rotations": 1 << Attribute.ROTATION,
    "scales": 1 << Attribute.SCALE,
    "opacities": 1 << Attribute.OPACITY,
    "sh_dc": 1 << Attribute.SH_DC,
    "sh_rest": 1 << Attribute.SH_1 | 1 << Attribute.SH_2 | 1 << Attribute.SH_3,
}
_UNLIMITED = (1 << 63) - 1


def disagreement(head: ChunkHead) -> VerificationError:
    """The error of a frame whose hash is not that of the file."""
    return VerificationError(
        f"frame {head.frame_index} decodes to other values than its encoder had: please report this file",
        offset=head.offset,
    )


class CoreFrame:
    """A decoded frame; the core has it until the next one, before which it is copied if anybody holds it."""

    def __init__(self, decoder: CoreDecoder) -> None:
        self._decoder: CoreDecoder | None = decoder
        self._sequence = decoder.sequence
        self._state: FrameState | None = None

    @property
    def state(self) -> FrameState:
        """Its integers."""
        if self._state is None:
            assert self._decoder is not None
            self._state = self._decoder.snapshot()
        return self._state

    def cloud(self) -> GaussianCloud:
        """Its floats, in output order."""
        if self._decoder is not None:
            return self._decoder.cloud()
        return output(self.state, self._sequence.unit_exponents)

    def leave(self) -> None:
        """The core goes on: what it holds becomes that of another frame."""
        if self._decoder is not None:
            assert self.state is not None
            self._decoder = None


class CoreDecoder:
    """Decodes the frames of GoFs in turn; holds the last one."""

    def __init__(
        self, container: ContainerReader, words: bytes, limits: DecoderLimits, *, check: bool
    ) -> None:
        self.sequence = container.sequence
        self._container, self._limits = container, limits
        self._attributes = coded_attributes(self.sequence.sh_degree)
        self._core = Instance()
        address = self._room("core_room", len(words))
        self._core.put(address, words)
        self._called("core_open", address, len(words) // 4)
        reader = container.payload(container.sequence_head)
        offset, header = reader.offset, reader.raw(reader.remaining)
        address = self._room("core_room", len(header))
        self._core.put(address, header)
        most = -1 if limits.max_gaussians is None else min(limits.max_gaussians, _UNLIMITED)
        memory = min(limits.max_memory, _UNLIMITED)
        self._called("core_begin", address, len(header), offset, memory, most, int(check))
        self._last: weakref.ref[CoreFrame] | None = None
        self._planes: dict[Attribute, Plane] = {}
        self._order: Plane | None = None
        self._arrays: dict[str, Floats] = {}
        #: planes that changed since they were copied, and since their floats were
        self._stale = self._stale_floats = -1

    @staticmethod
    def of(
        container: ContainerReader, model: ContextModel, limits: DecoderLimits, *, check: bool
    ) -> CoreDecoder | None:
        """That of a file; None where the core does not hold its model."""
        words = words_of(model)
        try:
            return None if words is None else CoreDecoder(container, words, limits, check=check)
        except ModelMismatch:
            return None

    def frame(self, head: ChunkHead, behind: Iterator[ChunkHead]) -> CoreFrame:
        """Decode the frame that begins with `head`; its other chunks are the next ones of `behind`."""
        self._leave()
        if head.chunk_type == ChunkType.INTRA_FRAME:
            self._stale = self._stale_floats = -1
        self._put(head, head)
        while self._record.expects:
            kind, chunk = ChunkType(self._record.expects), next(behind, None)
            if chunk is None or chunk.chunk_type != kind or chunk.frame_index != head.frame_index:
                raise missing_part(kind, chunk)
            self._put(chunk, head)
        self._stale |= self._record.touched
        self._stale_floats |= self._record.touched
        frame = CoreFrame(self)
        self._last = weakref.ref(frame)
        return frame

    def _leave(self) -> None:
        frame = None if self._last is None else self._last()
        if frame is not None:
            frame.leave()
        self._last = None

    def _put(self, chunk: ChunkHead, head: ChunkHead) -> None:
        reader = self._container.payload(chunk)
        data = reader.raw(reader.remaining)
        address = self._room("core_payload", chunk.chunk_type, len(data))
        self._core.put(address, data)
        where = (chunk.offset, chunk.payload_offset, chunk.end - chunk.offset)
        self._called("core_put", chunk.chunk_type, chunk.frame_index, *where, address, len(data), head=head)

    def _room(self, name: str, *arguments: int) -> int:
        return self._core.call(name, *arguments) or self._refuse_memory()

    def _called(self, name: str, *arguments: int, head: ChunkHead | None = None) -> None:
        status = self._core.call(name, *arguments)
        self._record = self._core.record()
        if status:
            raise self._error(status, self._record, head)

    def _refuse_memory(self) -> int:
        raise ResourceLimit(
            "the frames need more memory than the core has, 4 GiB",
            "max_memory",
            self._limits.max_memory,
            "--engine numpy decodes it",
        )

    def _error(self, status: int, record: Record, head: ChunkHead | None) -> DfcgsError:
        offset = None if record.offset < 0 else record.offset
        if status in _ERRORS:
            return _ERRORS[status](self._core.text_at(record.message), offset=offset)
        if status == _HASH and head is not None:
            return disagreement(head)
        if status == _RESOURCES:
            return self._excess(record)
        if status == _MEMORY:
            self._refuse_memory()
        raise AssertionError(f"the core refused a call of its own decoder: {status}")

    def _excess(self, record: Record) -> ResourceLimit:
        frame, count = record.excess_frame, record.excess_gaussians
        return {
            1: lambda: too_many(self._limits, frame, count),
            2: lambda: too_large(self._limits, frame, count, record.excess_value),
            3: lambda: unpaid_memory(frame, count, record.num_bytes),
            4: lambda: unpaid_work(frame, count, record.num_bytes),
        }[record.excess_kind]()

    def snapshot(self) -> FrameState:
        """A copy of the frame; planes that did not change are those of the copy before."""
        record, count = self._record, self._record.count
        for attribute in self._attributes:
            if self._stale >> attribute & 1:
                shape = (count, STATE_COLUMNS[attribute])
                values = self._core.array_at(record.planes[attribute], "<i4", shape)
                self._planes[attribute] = Plane(values)
        if self._stale >> _ORDER_BIT & 1:
            places = self._core.array_at(record.order, "<i4", (count, 1)) if record.has_order else None
            self._order = None if places is None else Plane(places)
        self._stale = 0
        return FrameState(dict(self._planes), self._order, self._verbatim(), escapes=self._escapes())

    def _verbatim(self) -> GaussianCloud | None:
        record = self._record
        if not record.has_patterns:
            return None
        columns = [
            self._core.array_at(record.patterns[a], _FLOATS, (record.count, STATE_COLUMNS[a]))
            for a in self._attributes
        ]
        return cloud_of_columns(columns)

    def _escapes(self) -> Escapes | None:
        record = self._record
        if not record.escapes:
            return None
        payload = self._core.bytes_at(record.escapes, record.escape_bytes)
        return Escapes.read(ByteReader(payload), self.sequence, record.count)

    def cloud(self) -> GaussianCloud:
        """The frame as floats; arrays of planes that did not change are those of the cloud before."""
        is_exact = self._record.has_patterns or bool(self._record.escapes)
        if is_exact or self._stale_floats >> _ORDER_BIT & 1:
            self._stale_floats = -1
        wanted = {name: bool(self._stale_floats & bits) for name, bits in _ARRAYS.items()}
        if any(wanted.values()):
            self._called("core_output", sum(w << i for i, w in enumerate(wanted.values())))
        for name, address in zip(_ARRAYS, self._record.arrays, strict=True):
            if wanted[name]:
                self._arrays[name] = self._core.array_at(address, self._type_of(name), self._shape_of(name))
        # float values as they were are no state's
        self._stale_floats = -1 if is_exact else 0
        return GaussianCloud(**self._arrays)

    def _type_of(self, name: str) -> str:
        is_wide = name == "positions" and self.sequence.unit_exponents.precision == Precision.FLOAT64
        return "<f8" if is_wide else "<f4"

    def _shape_of(self, name: str) -> tuple[int, ...]:
        rest = (3, SH_REST_COEFFICIENTS[self.sequence.sh_degree])
        shapes = {"positions": (3,), "rotations": (4,), "scales": (3,), "opacities": (), "sh_dc": (3,)}
        return (self._record.count, *shapes.get(name, rest))
