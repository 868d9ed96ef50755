"""What a file may ask of the machine that decodes it: memory and work, known from headers alone.

A few bytes can announce millions of Gaussians. So each frame is charged before anything is allocated for it:
its memory is estimated, its work is added up, and both are held against what the bytes read so far pay for.
Memory is in bytes of the whole process, work in nanoseconds of an ordinary core; the constants were measured
(`tests/troubles/test_bombs.py` holds them against what decoding takes).
"""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.constants import MAX_CONTROL_POINTS, STATE_COLUMNS, Attribute, Tool
from dfcgs_codec.bitstream.frame_headers import ControlHeader, InterHeader, IntraHeader
from dfcgs_codec.bitstream.motion_header import LatentHeader
from dfcgs_codec.bitstream.topology_header import TopologyHeader
from dfcgs_codec.errors import ResourceLimit

#: what a process takes before its first Gaussian: interpreter, libraries, models
_PROCESS = 96 << 20
#: without `max_gaussians`: memory and work that every file is allowed, and what each of its bytes adds
_FREE_MEMORY, _MEMORY_PER_BYTE = 256 << 20, 4096
_FREE_WORK, _WORK_PER_BYTE = 300_000_000, 100_000


@dataclass(frozen=True)
class DecoderLimits:
    """Files that ask for more are refused, with ResourceLimit, before the memory is taken.

    `max_memory`: bytes that the process may need. `max_gaussians`: Gaussians a frame that are accepted
    however few bytes they take; None: as many, in all frames together, as the bytes read so far pay for.
    """

    max_memory: int = 2 << 30
    max_gaussians: int | None = None

    def __post_init__(self) -> None:
        """ValueError for limits below 1."""
        if self.max_memory < 1 or (self.max_gaussians is not None and self.max_gaussians < 1):
            raise ValueError(f"{self}: limits are 1 or more")


#: for files of one's own
UNLIMITED = DecoderLimits(max_memory=1 << 60, max_gaussians=1 << 60)


def intra_memory(num_gaussians: int, columns: int) -> int:
    """Bytes that an I-frame takes, or as many births; `columns`: values of a Gaussian."""
    return num_gaussians * (850 + 27 * columns)


def inter_memory(num_gaussians: int, columns: int, coded: int) -> int:
    """Bytes that a P-frame takes with all that is kept for it; `coded` of its columns have symbols."""
    return num_gaussians * (1500 + 27 * columns + 65 * coded)


def intra_work(num_gaussians: int, columns: int) -> int:
    """Of an I-frame or of births."""
    return 200_000 * columns + num_gaussians * (2500 + 130 * columns)


def output_work(num_gaussians: int, columns: int) -> int:
    """Of handing a frame out and writing it down."""
    return 200_000 + num_gaussians * (30 + 4 * columns)


def inter_work(num_gaussians: int, coded: int, tools: frozenset[Tool]) -> int:
    """Of a P-frame, control points, births and symbols left out; `coded`: columns that may have symbols."""
    each, fixed = 0, 0
    if tools or coded:
        each, fixed = 150, 1_000_000
    if coded:
        each += 100 + 15 * coded
        fixed += 20_000 * coded
    if Tool.MOTION in tools:
        each, fixed = each + 400, fixed + 5_000_000
    if Tool.TOPOLOGY in tools:
        each += 1500
    if Tool.LATENT in tools:
        each, fixed = each + 1000, fixed + 5_000_000
    if Tool.REFINEMENT in tools:
        each += 25_000
    return fixed + num_gaussians * each


def control_work(num_gaussians: int, num_points: int) -> int:
    """Of choosing control points and finding whom each Gaussian follows, once a GoF."""
    return 3000 * num_gaussians + 10 * num_points * num_gaussians


class Budget:
    """What a file has asked for so far, held against `limits`; ResourceLimit where that is too much."""

    def __init__(self, limits: DecoderLimits, attributes: list[Attribute]) -> None:
        self._limits = limits
        self._columns = sum(STATE_COLUMNS[a] for a in attributes)
        self._bytes = self._work = 0
        self._frame = self._num_gaussians = 0
        self._control: ControlHeader | None = None
        self._points_are_chosen = False

    def read(self, num_bytes: int) -> None:
        """Bytes of a chunk that was read."""
        self._bytes += num_bytes

    def chunk(self, frame: int, header: object) -> None:
        """Charge what the header of a chunk of a frame announces; symbols are charged when they were read."""
        self._frame = frame
        if isinstance(header, IntraHeader):
            self._intra(header)
        elif isinstance(header, InterHeader):
            self._inter(header)
        elif isinstance(header, TopologyHeader):
            self._topology(header)
        elif isinstance(header, LatentHeader):
            shares = header.num_coded * min(header.spread.num_neighbours, self._num_gaussians)
            self._spend(150 * shares)

    def symbols(self, num_symbols: int) -> None:
        """Charge what was read from a stream of motion or residual."""
        self._spend(250 * num_symbols)

    def _intra(self, header: IntraHeader) -> None:
        self._num_gaussians, self._control = header.num_gaussians, header.control
        self._points_are_chosen = False
        self._take(intra_memory(self._num_gaussians, self._columns))
        self._spend(
            intra_work(self._num_gaussians, self._columns) + output_work(self._num_gaussians, self._columns)
        )

    def _inter(self, header: InterHeader) -> None:
        count, coded = self._num_gaussians, sum(STATE_COLUMNS[a] for a in header.steps)
        work = output_work(count, self._columns) + inter_work(count, coded, header.tools)
        if self._control is not None:
            points = min(max(1, count // self._control.spacing), MAX_CONTROL_POINTS)
            if header.tools - {Tool.VISIBILITY} and not self._points_are_chosen:
                work += control_work(count, points)
                self._points_are_chosen = True
            if Tool.LATENT in header.tools:
                work += 50_000 * points
        if header.tools or header.steps:
            self._take(inter_memory(count, self._columns, coded))
        self._spend(work)

    def _topology(self, header: TopologyHeader) -> None:
        self._num_gaussians += header.num_births - header.num_removals
        if header.num_births:
            memory = intra_memory(header.num_births, self._columns)
            self._take(memory + inter_memory(self._num_gaussians, self._columns, self._columns))
            self._spend(intra_work(header.num_births, self._columns))

    def _take(self, memory: int) -> None:
        limits, count, memory = self._limits, self._num_gaussians, memory + _PROCESS
        if limits.max_gaussians is not None and count > limits.max_gaussians:
            raise too_many(limits, self._frame, count)
        if memory > limits.max_memory:
            raise too_large(limits, self._frame, count, memory)
        if limits.max_gaussians is None and memory > _FREE_MEMORY + _MEMORY_PER_BYTE * self._bytes:
            raise unpaid_memory(self._frame, count, self._bytes)

    def _spend(self, work: int) -> None:
        self._work += work
        if self._limits.max_gaussians is None and self._work > _FREE_WORK + _WORK_PER_BYTE * self._bytes:
            raise unpaid_work(self._frame, self._num_gaussians, self._bytes)


def too_many(limits: DecoderLimits, frame: int, num_gaussians: int) -> ResourceLimit:
    """More Gaussians than are allowed."""
    what = f"{_asked(frame, num_gaussians)}, at most {limits.max_gaussians} are allowed"
    return ResourceLimit(what, "max_gaussians", num_gaussians)


def too_large(limits: DecoderLimits, frame: int, num_gaussians: int, memory: int) -> ResourceLimit:
    """More memory than is allowed."""
    allowed = f"at most {_mib(limits.max_memory)} are allowed"
    what = f"{_asked(frame, num_gaussians)}: about {_mib(memory)} of memory, {allowed}"
    return ResourceLimit(what, "max_memory", memory)


def unpaid_memory(frame: int, num_gaussians: int, num_bytes: int) -> ResourceLimit:
    """More memory than the bytes so far pay for."""
    what = f"{_asked(frame, num_gaussians)}, and {num_bytes} bytes so far: {_BOMB}"
    return ResourceLimit(what, "max_gaussians", num_gaussians)


def unpaid_work(frame: int, num_gaussians: int, num_bytes: int) -> ResourceLimit:
    """More work than the bytes so far pay for."""
    what = f"frames up to {frame} are far more work than {num_bytes} bytes usually are: {_BOMB}"
    return ResourceLimit(what, "max_gaussians", num_gaussians)


def _asked(frame: int, num_gaussians: int) -> str:
    return f"frame {frame} has {num_gaussians} Gaussians"


_BOMB = "made to exhaust a decoder, or nothing but repetition"


def _mib(num_bytes: int) -> str:
    return f"{-(-num_bytes >> 20)} MiB"
