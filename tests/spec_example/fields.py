"""The bytes of a file, field by field: knows the syntax, not the package's headers."""

from __future__ import annotations

from collections.abc import Callable

from dfcgs_codec.bitstream.constants import (
    MODEL_HASH_BYTES,
    Attribute,
    ChunkType,
    IntraKind,
    OutputOrder,
    Precision,
    Tool,
)
from dfcgs_codec.bitstream.frame_headers import intra_streams
from dfcgs_codec.bitstream.io import ByteReader

_BYTES_PER_LINE = 16
_NUM_PLAIN = Attribute.SH_DC + 1


class _Tracer:
    """Reads fields and writes down where they stood."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._reader = ByteReader(data)
        self.lines: list[str] = []
        self.attributes: list[Attribute] = []

    def _put(self, start: int, label: str) -> None:
        field = self._data[start : self._reader.position]
        for first in range(0, len(field), _BYTES_PER_LINE):
            text = field[first : first + _BYTES_PER_LINE].hex(" ")
            shown = label if first == 0 else ""
            self.lines.append(f"{start + first:04x}  {text:<48} {shown}".rstrip())

    def number(self, kind: str, name: str, show: Callable[[int], str] = str) -> int:
        """A field of type `kind`; its value."""
        start = self._reader.position
        value = int(getattr(self._reader, kind)())
        self._put(start, f"{name} = {show(value)}")
        return value

    def raw(self, count: int, name: str) -> None:
        """Bytes."""
        start = self._reader.position
        self._reader.raw(count)
        self._put(start, name)

    def more(self) -> bool:
        """Whether the file goes on."""
        return self._reader.remaining > 0


def _hex(value: int) -> str:
    return f"0x{value:08x}"


def _sequence_header(trace: _Tracer) -> None:
    for name in ("bitstream_version", "profile", "level"):
        trace.number("u8", name)
    degree = trace.number("u8", "sh_degree")
    trace.attributes = list(Attribute)[: Attribute.SH_1 + degree]
    trace.number("u8", "output_order", lambda v: f"{v} {OutputOrder(v).name}")
    for name in ("num_frames", "frame_rate_numerator", "frame_rate_denominator"):
        trace.number("uvarint", name)
    for _ in range(trace.number("uvarint", "num_runs")):
        trace.number("uvarint", "skipped")
        trace.number("uvarint", "run_length_minus_1")
    for name in ("position", "scale", "opacity", "color"):
        trace.number("svarint", f"{name}_exponent")
    for axis in "xyz":
        trace.number("svarint", f"position_origin {axis}")
    trace.number("u8", "position_precision", lambda v: f"{v} {Precision(v).name}")
    trace.raw(trace.number("uvarint", "model_id_length"), "model_id")
    trace.raw(MODEL_HASH_BYTES, "model_hash")


def _streams(trace: _Tracer, names: list[str]) -> None:
    lengths = [trace.number("uvarint", f"stream_length of {name}") for name in names]
    for name, length in zip(names, lengths, strict=True):
        if length:
            trace.raw(length, f"stream of {name}")


def _intra_frame(trace: _Tracer) -> None:
    trace.raw(16, "frame_hash")
    trace.number("u8", "intra_kind", lambda v: f"{v} {IntraKind(v).name}")
    trace.number("uvarint", "num_gaussians")
    permuted = trace.number("u8", "has_permutation")
    trace.number("u8", "has_escapes")
    trace.number("uvarint", "control_spacing")
    trace.number("u8", "control_shift")
    trace.number("u8", "sort_shift")
    trace.number("u8", "sort_bits")
    for axis in "xyz":
        trace.number("svarint", f"sort_origin {axis}")
    trace.number("u8", "has_excess")
    for attribute in trace.attributes:
        trace.number("uvarint", f"step of {attribute.name}")
    trace.number("u8", "coarse_log2")
    for attribute in trace.attributes:
        trace.number("svarint", f"visibility_level of {attribute.name}")
    trace.number("u8", "thin_octaves")
    trace.number("u8", "alternating", lambda v: f"{v:#04x}")
    names = intra_streams(len(trace.attributes) - _NUM_PLAIN)
    _streams(trace, names[:1] + ["the permutation"] * permuted + names[1:])


def _inter_frame(trace: _Tracer) -> list[str]:
    trace.raw(16, "frame_hash")
    tools = trace.number("u8", "tools", lambda v: f"{v:#04x}")
    mask = trace.number("u8", "attribute_mask", lambda v: f"{v:#04x}")
    names = [attribute.name for attribute in trace.attributes if mask >> attribute & 1]
    for name in names:
        trace.number("uvarint", f"step of {name}")
    for name in names if tools >> Tool.VISIBILITY & 1 else []:
        trace.number("svarint", f"visibility_level of {name}")
    return names


def _motion_chunk(trace: _Tracer) -> None:
    trace.number("uvarint", "translation_step")
    trace.number("uvarint", "turn_step")
    _streams(trace, ["who follows", "control points"])


def _index(trace: _Tracer) -> None:
    for _ in range(trace.number("uvarint", "num_gofs")):
        trace.number("uvarint", "gof_num_frames")
        trace.number("uvarint", "offset_delta", lambda v: f"{v} (0x{v:x})")


def annotate(data: bytes) -> list[str]:
    """Lines of offset, bytes and field; their bytes are the file."""
    trace = _Tracer(data)
    trace.raw(8, "MAGIC")
    names: list[str] = []
    while trace.more():
        kind = ChunkType(trace.number("u8", "chunk_type", lambda v: f"0x{v:02x} {ChunkType(v).name}"))
        trace.number("uvarint", "frame_index")
        length = trace.number("uvarint", "payload_length")
        if kind == ChunkType.SEQUENCE_HEADER:
            _sequence_header(trace)
        elif kind == ChunkType.INTRA_FRAME:
            _intra_frame(trace)
        elif kind == ChunkType.INTER_FRAME:
            names = _inter_frame(trace)
        elif kind == ChunkType.MOTION:
            _motion_chunk(trace)
        elif kind == ChunkType.RESIDUAL:
            _streams(trace, names)
        elif kind == ChunkType.INDEX:
            _index(trace)
        elif kind == ChunkType.END:
            trace.number("u64", "index_offset", lambda v: f"{v} (0x{v:x})")
        else:
            trace.raw(length, "text")
        trace.number("u32", "crc32", _hex)
    return trace.lines
