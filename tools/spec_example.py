"""The worked example of bitstream_spec.md, annex A: a whole file, annotated field by field.

    python tools/spec_example.py             print the blocks of the annex
    python tools/spec_example.py --update    put them into bitstream_spec.md

The example's encoder takes the simplest choice everywhere and no float decides anything, so that the file
changes only when the format does.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import ClassVar, TypeVar
from unittest import mock

import numpy as np

from dfcgs_codec.bitstream.constants import (
    MODEL_HASH_BYTES,
    STATE_LIMIT,
    Attribute,
    ChunkType,
    IntraKind,
    OutputOrder,
    Precision,
    Profile,
    Tool,
)
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps, SortGrid, intra_streams
from dfcgs_codec.bitstream.io import ByteReader
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.codec.columns.coder import (
    ColumnFacts,
    HistogramEvidence,
    Int64,
    ResidualEvidence,
    SplitEvidence,
    UInt8,
    WeightEvidence,
)
from dfcgs_codec.codec.columns.column import ColumnGoal
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.columns.side_information import (
    ABSENT_LEVEL,
    EXPECTED_SCALE_RISE,
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.codec.frame import chunk_reader
from dfcgs_codec.codec.frame.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.intra.turns import ChooseTurns, TurnContexts, Turns, TurnWalk
from dfcgs_codec.codec.motion.walk import MIXED, MotionSymbols
from dfcgs_codec.codec.residual.classes import AttributeActivity, InterSymbols
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.frame import chunk_writer, frame_coding
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.entropy.coder import Model
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, scale_table
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model
from dfcgs_codec.transform.rotation import round_divide

SPEC = Path(__file__).resolve().parents[1] / "bitstream_spec.md"

T = TypeVar("T")

_FLAT_BIAS = 5
_BYTES_PER_LINE = 16

_PRIOR = context_model(DEFAULT_PRIOR)
_HEADER = SequenceHeader(
    profile=Profile.MAIN,
    level=1,
    sh_degree=0,
    output_order=OutputOrder.INPUT,
    frame_rate=(30, 1),
    frame_numbers=FrameNumbers(((7, 2),)),
    unit_exponents=UnitExponents(position=-4, scale=-12, opacity=-12, color=-12),
    model_id=_PRIOR.model_id,
    model_hash=_PRIOR.digest[:MODEL_HASH_BYTES],
)
_STEPS = {
    Attribute.POSITION: 4,
    Attribute.SCALE: 512,
    Attribute.ROTATION: 4096,
    Attribute.OPACITY: 512,
    Attribute.SH_DC: 512,
}
_CONTROL = ControlHeader(spacing=1, shift=1)
_MOTION = MotionHeader(translation_step=2, turn_step=4096)
_CONTROL_SYMBOLS = [[1, -1, 0, 0, 0, 2], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]
_FOLLOWS = [False, True, False]
#: the position of the second Gaussian, whose alpha is lower, has coarser steps
_LEVELS = {attribute: 0 if attribute == Attribute.POSITION else -1000 for attribute in _STEPS}
_GRID = SortGrid(shift=0, bits=2, origin=(-1, 0, 2), has_excess=False)
_POSITIONS = [[-2, 0, 5], [0, 1, 9], [5, 7, 6]]
#: in steps; axis 2 of the scales: how thin it is
_COLUMNS = {
    Attribute.SCALE: [[-40, -44, 4], [-41, -41, 9], [-36, -40, 0]],
    Attribute.OPACITY: [[12], [-3], [20]],
    Attribute.SH_DC: [[4, -2, 0], [1, 1, 1], [-6, 2, 3]],
}
#: tilts, spins and flips
_TURNS = Turns(np.array([[3, -2], [0, 5], [0, 0]]), np.array([1, -1, 0]), np.array([0, 2, 0]))
_COVER = [0, 2, 0]
_PERMUTATION = [2, 0, 1]
_INTRA_LEVELS = {
    Attribute.POSITION: -20,
    Attribute.SCALE: 0,
    Attribute.ROTATION: -120,
    Attribute.OPACITY: -80,
    Attribute.SH_DC: -100,
}
_INTRA_STEPS = IntraSteps(
    _STEPS, coarse_log2=1, levels=_INTRA_LEVELS, thin_octaves=2, alternating=frozenset({Attribute.SH_DC})
)
_INTER = {
    Attribute.POSITION: [[0, 0, 0], [1, 0, -1], [0, 0, 0]],
    Attribute.ROTATION: [[0, 0, 0], [0, 2, 0], [0, 0, 0]],
}


class PlainWriter(SymbolWriter):
    """Predicts nothing but the middle value, and has one Laplace scale per column."""

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """All zero."""
        return code_weights(self, np.zeros(count, np.int64), count)

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """The smallest Laplace scale without escapes for the contexts used, rising as expected."""
        residuals, contexts = evidence()
        largest = int(np.abs(residuals).max())
        scale = next(s for s in range(64) if len(scale_table(Shape.LAPLACE, s)) // 2 > largest)
        tables = np.full(num_contexts, -1, np.int64)
        used = np.arange(contexts.min(), int(contexts.max()) + 1)
        tables[used] = Shape.LAPLACE * NUM_SCALES + scale + EXPECTED_SCALE_RISE * (used - used[0])
        return code_tables(self, tables, num_contexts)

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """Level 0 for every symbol that occurs, absent for the others."""
        symbols, contexts = evidence()
        levels = np.full((len(used), size), ABSENT_LEVEL, np.int64)
        levels[np.searchsorted(used, contexts), symbols] = 0
        return histogram_models(self, levels, used, num_contexts, size)

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """The value in the middle."""
        values = np.sort(evidence().values)
        center = code_signed(self, int(values[len(values) // 2]), STATE_LIMIT)
        return center, self.weights(1 + num_before, _nothing), self.weights(2 + num_before, _nothing)

    def split_bias(self, evidence: SplitEvidence) -> int:
        """That of cells whose halves hold any number of Gaussians with the same probability."""
        return self.choice(16, lambda: _FLAT_BIAS)


def _nothing() -> tuple[list[Int64], Int64]:
    return [], np.zeros(0, np.int64)


class _Target(IntraTarget):
    """Columns to the nearest value, turns as they are given."""

    def column(
        self, attribute: Attribute, column: int, decoded: Mapping[Attribute, Int64], before: list[Int64]
    ) -> ColumnGoal:
        """See IntraGoal."""
        values = np.array(_COLUMNS[attribute])[:, column] * _STEPS[attribute]

        def choose(rows: slice, prediction: Int64, steps: Int64, _: UInt8) -> Int64:
            return round_divide(values[rows] - prediction, steps)

        return ColumnGoal(values, choose)

    def turns(self, walk: TurnWalk) -> ChooseTurns:
        """See IntraGoal."""

        def choose(rows: slice, _: Int64, __: TurnContexts) -> Turns:
            return Turns(_TURNS.tilts[rows], _TURNS.spins[rows], _TURNS.flips[rows])

        return choose

    def beside(self, work: Callable[[], None]) -> Callable[[], None]:
        """See IntraGoal."""
        work()
        return lambda: None


def _target() -> _Target:
    places = np.array(_PERMUTATION, np.int64)
    unused = Quantisation(_HEADER.unit_exponents, {}, frozenset(), {}, frozenset())
    positions, cover = np.array(_POSITIONS, np.int64), np.array(_COVER, np.int64)
    return _Target({}, positions, cover, _INTRA_STEPS, unused, 0.5, places, keeps_names=True)


def _inter_symbols() -> InterSymbols:
    activity = {}
    for attribute, rows in _INTER.items():
        symbols = np.array(rows, np.int64)
        # one block, of which few Gaussians move, by one or two steps
        activity[attribute] = AttributeActivity(symbols, np.array([1]), np.array([5]))
    return InterSymbols(activity)


def _motion(intra: frame_coding.CodedFrame) -> MotionGoal:
    """The first control point moves, the second Gaussian follows."""
    motion = intra.state.motion()
    follows = np.array(_FOLLOWS)
    symbols = MotionSymbols(np.array(_CONTROL_SYMBOLS, np.int64), np.array([MIXED]), follows)
    return MotionGoal(_MOTION, symbols, motion.carry(_MOTION, symbols, intra.state.frame))


def build() -> bytes:
    """The file."""
    file = io.BytesIO()
    container = ContainerWriter(file, _HEADER)
    container.chunk(ChunkType.ENCODER_INFO, 0, b"worked example")
    with mock.patch.object(chunk_writer, "SymbolWriter", PlainWriter):
        task = frame_coding.IntraTask(_target(), _GRID)
        intra = frame_coding.coded_intra(FrameWriter(_HEADER, _PRIOR, 0), task, _CONTROL)
        writer = FrameWriter(_HEADER, _PRIOR, 1)
        steps = _STEPS, _LEVELS
        inter = frame_coding.coded_inter(writer, _inter_symbols(), intra.state, steps, _motion(intra))
    container.gof(0, [intra.data, inter.data])
    container.finish()
    return file.getvalue()


class _Tracer:
    """Reads fields and writes down where they stood; knows the syntax, not the package's headers."""

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
    names = intra_streams(len(trace.attributes) - len(_STEPS))
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


def _rows(values: np.ndarray) -> str:
    return "  ".join(" ".join(f"{value:.9g}" for value in row) for row in values.reshape(len(values), -1))


def _describe(frame: DecodedFrame) -> Iterator[str]:
    yield f"frame {frame.index}, number {frame.number}: hash {frame.state.hash().hex()}"
    for attribute, plane in frame.state.planes.items():
        yield f"  state {attribute.name:<9} {_rows(plane.values)}"
    if frame.state.order is not None:
        yield f"  state order     {_rows(frame.state.order.values)}"
    cloud = frame.cloud()
    for name, values in (
        ("x y z", cloud.positions),
        ("scale", cloud.scales),
        ("rot", cloud.rotations),
        ("opacity", cloud.opacities),
        ("f_dc", cloud.sh_dc),
    ):
        yield f"  output {name:<8} {_rows(values)}"


def frames(data: bytes) -> list[str]:
    """Lines of states, hashes and output of the file's frames."""
    return [line for frame in SequenceDecoder(io.BytesIO(data)).frames() for line in _describe(frame)]


class _TracingReader(SymbolReader):
    """Writes down the symbols of every model."""

    streams: ClassVar[list[list[str]]] = []
    _label = "symbols"

    def __init__(self, data: bytes, offset: int | None = None) -> None:
        super().__init__(data, offset)
        self.streams.append([])

    def code(self, symbols: Int64 | None, model: Model, count: int) -> Int64:
        """See RangeReader."""
        decoded = super().code(symbols, model, count)
        if count:
            text = " ".join(map(str, decoded.tolist()))
            self.streams[-1].append(f"  {self._label:<10} {count} of {model.size:<4} {text}")
        return decoded

    def _labelled(self, label: str, read: Callable[..., T], *arguments: object) -> T:
        self._label = label
        result = read(*arguments)
        self._label = "symbols"
        return result

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """See SymbolCoder."""
        return self._labelled("predictor", super().predictor, num_before, evidence)

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """See SymbolCoder."""
        return self._labelled("weights", super().weights, count, evidence)

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """See SymbolCoder."""
        return self._labelled("tables", super().tables, num_contexts, evidence)

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """See SymbolCoder."""
        return self._labelled("histograms", super().histograms, used, num_contexts, size, evidence)


def symbols(data: bytes) -> list[str]:
    """Lines of the symbols of some streams: what they say, their number, the size of their model, symbols."""
    _TracingReader.streams.clear()
    with mock.patch.object(chunk_reader, "SymbolReader", _TracingReader):
        frames(data)
    names = {
        0: "POSITION, frame 0",
        1: "the permutation, frame 0",
        2: "COVER, frame 0",
        3: "SCALE, frame 0",
        5: "POSITION_BITS, frame 0",
        6: "ROTATION, frame 0",
        8: "who follows, frame 1",
        9: "control points, frame 1",
        10: "POSITION, frame 1",
    }
    return [
        line
        for index, name in names.items()
        for line in (f"stream of {name}", *_TracingReader.streams[index])
    ]


def blocks() -> dict[str, list[str]]:
    """The annex's blocks by name."""
    data = build()
    return {"file": annotate(data), "frames": frames(data), "symbols": symbols(data)}


def main() -> None:
    """Print or update."""
    text = SPEC.read_text(encoding="utf-8")
    for name, lines in blocks().items():
        body = "\n".join(lines)
        if "--update" in sys.argv[1:]:
            pattern = rf"(<!-- example: {name} -->\n\n```\n).*?(\n?```)"
            text = re.sub(pattern, lambda m, body=body: m[1] + body + "\n```", text, flags=re.DOTALL)
        else:
            print(body, end="\n\n")
    if "--update" in sys.argv[1:]:
        SPEC.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
