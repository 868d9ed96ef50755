"""Small files that ask for much: what no encoder would write, and a decoder must bear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, encode_sequence
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute, ChunkType, IntraKind
from dfcgs_codec.bitstream.frame_headers import (
    IntraHeader,
    IntraSteps,
    SortGrid,
    coded_attributes,
)
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.limits import UNLIMITED
from dfcgs_codec.codec.frame.topology import TopologyGoal
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.motion.walk import FOLLOW, MotionSymbols
from dfcgs_codec.codec.residual.classes import (
    DENSE,
    AttributeActivity,
    InterSymbols,
    num_blocks,
    num_inter_columns,
)
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.frame.frame_coding import coded_inter, topology_goal
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.model.registry import context_model
from dfcgs_codec.transform.rotation import ONE
from lab.chunks import Chunk, join_chunks, split_chunks
from lab.options import encoder_options
from lab.small_clouds import make_cloud

#: decodes a file in a fresh process: frames, name of the error, peak MiB, seconds of CPU
FRESH = """
import json, sys, time
from dfcgs_codec import DfcgsError, decode_sequence
frames, error = 0, ""
try:
    for frame in decode_sequence(sys.argv[1]):
        frame.cloud()
        frames += 1
except DfcgsError as refusal:
    error = type(refusal).__name__
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([frames, error, int(peak.split()[1]) / 1024, time.process_time()]))
"""
#: no more bytes than this
MOST_BYTES = 10_000


def alike(count: int, sh_degree: int = 0) -> GaussianCloud:
    """One Gaussian again and again: hardly any bytes."""
    return make_cloud(1, sh_degree).take(np.zeros(count, np.int64))


def lattice(count: int) -> GaussianCloud:
    """Equal Gaussians at the points of a grid: few bytes, and all distances many times."""
    side = int(np.ceil(count ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:count]
    return replace(alike(count), positions=(grid * 0.01).astype(np.float32))


@cache
def file_of_alike(count: int) -> bytes:
    """A file of `count` equal Gaussians of SH degree 0."""
    return encoded(alike(count))


def encoded(cloud: GaussianCloud, options: EncoderOptions | None = None) -> bytes:
    """A file of one frame."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.dgs"
        encode_sequence([cloud], path, options or EncoderOptions())
        return path.read_bytes()


def with_header(data: bytes, **changes: object) -> bytes:
    """The file with another sequence header."""
    chunks = split_chunks(data)
    sequence = SequenceHeader.read(ByteReader(chunks[0].payload))
    return join_chunks(
        [Chunk(ChunkType.SEQUENCE_HEADER, 0, _bytes(replace(sequence, **changes))), *chunks[1:]]
    )


def with_intra(data: bytes, **changes: object) -> bytes:
    """The file with another I-frame header, and all streams empty."""
    chunks = split_chunks(data)
    sequence = SequenceHeader.read(ByteReader(chunks[0].payload))
    intra = next(c for c in chunks if c.chunk_type == ChunkType.INTRA_FRAME)
    header = replace(IntraHeader.read(ByteReader(intra.payload), sequence), **changes)
    lengths = bytes(len(header.streams(sequence.sh_degree)))
    return join_chunks([chunks[0], replace(intra, payload=_bytes(header) + lengths)])


def _bytes(header: SequenceHeader | IntraHeader) -> bytes:
    writer = ByteWriter()
    header.write(writer)
    return writer.getvalue()


@dataclass(frozen=True)
class Kind:
    """What each P-frame asks for: symbols, motion of all control points, new Gaussians."""

    residual: bool = False
    motion: bool = False
    births: int = 0


class Crafted:
    """A file whose P-frames change nothing, at the cost that `kind` says; all hashes are right."""

    def __init__(self, base: bytes) -> None:
        chunks = split_chunks(base)
        self._sequence = SequenceHeader.read(ByteReader(chunks[0].payload))
        self._intra = next(c for c in chunks if c.chunk_type == ChunkType.INTRA_FRAME)
        self._model = context_model(self._sequence.model_id)
        header = IntraHeader.read(ByteReader(self._intra.payload), self._sequence)
        (frame,) = SequenceDecoder(BytesIO(base), limits=UNLIMITED).frames()
        units, on_grid = self._sequence.unit_exponents, frame.state.on_grid()
        self._state = GofState.of_intra(on_grid, header.control, header.steps, units, self._model)
        self._frames: list[FrameWriter] = []
        self._attributes = coded_attributes(self._sequence.sh_degree)

    def data(self) -> bytes:
        """The file so far."""
        numbers = FrameNumbers(((0, len(self._frames) + 1),))
        first = Chunk(ChunkType.SEQUENCE_HEADER, 0, _bytes(replace(self._sequence, frame_numbers=numbers)))
        frames = enumerate(self._frames, 1)
        parts = [Chunk(c.kind, index, c.payload()) for index, frame in frames for c in frame.chunks]
        return join_chunks([first, self._intra, *parts])

    def add(self, kind: Kind) -> None:
        """Append a P-frame."""
        topology = self._replaced(kind.births) if kind.births else None
        state = self._state if topology is None else self._state.survivors(topology.kept)
        motion = self._motion(state) if kind.motion else None
        symbols = self._residual(state) if kind.residual else InterSymbols()
        writer = FrameWriter(self._sequence, self._model, len(self._frames) + 1)
        steps = dict.fromkeys(self._attributes, 1), {}
        coded = coded_inter(writer, symbols, self._state, steps, motion, topology)
        self._frames.append(writer)
        self._state = coded.state

    def _replaced(self, count: int) -> TopologyGoal:
        """All Gaussians but one go, `count` come."""
        n = self._state.frame.num_gaussians
        units = self._sequence.unit_exponents
        steps = IntraSteps(
            dict.fromkeys(self._attributes, 1), 0, dict.fromkeys(self._attributes, 0), 0, frozenset()
        )
        planes = {a: np.zeros((count, STATE_COLUMNS[a]), np.int64) for a in self._attributes}
        planes[Attribute.ROTATION][:, 0] = ONE
        quantisation = Quantisation(units, steps.steps, frozenset(), {}, frozenset())
        none = np.zeros(count, np.int64)
        grid = SortGrid(0, 0, (0, 0, 0), False)
        births = IntraTarget(planes, planes[Attribute.POSITION], none, steps, grid, quantisation, 0.5)
        return topology_goal(np.arange(1), n, births)

    def _motion(self, state: GofState) -> MotionGoal:
        """All follow control points that stand still."""
        motion, n = state.motion(), state.frame.num_gaussians
        header = MotionHeader(1, 1)
        symbols = MotionSymbols.none(motion.field.num_points, n)
        symbols = replace(symbols, modes=symbols.modes + FOLLOW, follows=np.ones(n, np.bool_))
        return MotionGoal(header, symbols, motion.carry(header, symbols, state.frame))

    def _residual(self, state: GofState) -> InterSymbols:
        """Symbols of all Gaussians, all zero."""
        n = state.frame.num_gaussians
        density = np.full(num_blocks(n), DENSE)
        return InterSymbols(
            {
                a: replace(AttributeActivity.none(n, num_inter_columns(a)), density=density)
                for a in self._attributes
            }
        )


def repeated(base: bytes, kind: Kind, most: int) -> bytes:
    """As many P-frames of a kind as fit the bytes, at most `most`."""
    crafted = Crafted(base)
    data = base
    for _ in range(most):
        crafted.add(kind)
        longer = crafted.data()
        if len(longer) > MOST_BYTES:
            break
        data = longer
    return data


def many_frames() -> bytes:
    """The longest sequence that the last level allows, announced by a file of one Gaussian."""
    return with_header(encoded(make_cloud(1)), level=3, frame_numbers=FrameNumbers(((0, 1 << 20),)))


def many_gofs() -> bytes:
    """The same I-frame again and again."""
    data = encoded(alike(20_000))
    chunks = split_chunks(data)
    count = MOST_BYTES // (len(chunks[-1].payload) + 15) - 1
    data = with_header(data, frame_numbers=FrameNumbers(((0, count),)))
    header = split_chunks(data)[0]
    intra = next(c for c in chunks if c.chunk_type == ChunkType.INTRA_FRAME)
    return join_chunks([header, *(replace(intra, frame_index=i) for i in range(count))])


def claimed(count: int, **changes: object) -> bytes:
    """So many Gaussians in empty streams."""
    return with_intra(with_header(encoded(make_cloud(40)), level=3), num_gaussians=count, **changes)


#: name: file, and the errors that it may end with, "" where its frames come out
BOMBS: dict[str, tuple[Callable[[], bytes], set[str]]] = {
    "a million frames": (many_frames, {"CorruptBitstream"}),
    "16 million Gaussians": (lambda: claimed(1 << 24), {"ResourceLimit"}),
    "as many as are let in": (lambda: file_of_alike(60_000), {""}),
    "verbatim, SH degree 2": (lambda: encoded(alike(30_000, 2), encoder_options(intra=IntraKind.PLY)), {""}),
    "many groups of frames": (many_gofs, {"ResourceLimit"}),
    "frames that repeat": (lambda: repeated(file_of_alike(60_000), Kind(), 150), {"ResourceLimit"}),
    "control points": (
        lambda: repeated(encoded(lattice(3000), encoder_options(control_spacing=1)), Kind(motion=True), 15),
        {"", "ResourceLimit"},
    ),
    "residuals": (lambda: repeated(encoded(alike(300, 1)), Kind(residual=True), 25), {"", "ResourceLimit"}),
    "new Gaussians": (lambda: repeated(file_of_alike(2000), Kind(births=2000), 25), {"", "ResourceLimit"}),
}
