"""The sequence header, `write` beside `read` (spec section 4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dfcgs_codec.bitstream.constants import (
    BITSTREAM_VERSION,
    LEVELS,
    MAX_OPACITY_EXPONENT,
    MAX_ORIGIN,
    MODEL_HASH_BYTES,
    LevelLimits,
    OutputOrder,
    Precision,
    Profile,
)
from dfcgs_codec.bitstream.fields import read_bounded, read_enum, read_point
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.errors import CorruptBitstream, LimitExceeded, UnsupportedBitstream

_MAX_SH_DEGREE = 3
_MAX_UNIT_EXPONENT = 60
_MAX_MODEL_ID = 64
_MAX_NETWORK_SCALE_EXPONENT = 23
_NETWORK_COLOR_EXPONENTS = (-40, 21)


@dataclass(frozen=True)
class FrameNumbers:
    """Numbers of the frames in the names of the input files, as runs without gaps.

    `runs` is a tuple of (first_number, count), ascending, not adjacent.
    """

    runs: tuple[tuple[int, int], ...]

    @staticmethod
    def of(numbers: list[int]) -> FrameNumbers:
        """The runs of strictly ascending `numbers`."""
        runs: list[tuple[int, int]] = []
        for number in numbers:
            if runs and number == runs[-1][0] + runs[-1][1]:
                runs[-1] = (runs[-1][0], runs[-1][1] + 1)
            else:
                runs.append((number, 1))
        return FrameNumbers(tuple(runs))

    def expand(self) -> list[int]:
        """All numbers, ascending."""
        return [first + i for first, count in self.runs for i in range(count)]

    def write(self, writer: ByteWriter) -> None:
        """Number of runs, then for each the numbers skipped before it and its length less one."""
        writer.uvarint(len(self.runs))
        end = 0
        for first, count in self.runs:
            writer.uvarint(first - end)
            writer.uvarint(count - 1)
            end = first + count

    @staticmethod
    def read(reader: ByteReader, num_frames: int) -> FrameNumbers:
        """Refuses runs that do not add up to `num_frames`."""
        offset = reader.offset
        runs: list[tuple[int, int]] = []
        end, left = 0, num_frames
        for _ in range(read_bounded(reader.uvarint, num_frames, "num_runs", reader)):
            first = end + reader.uvarint()
            count = read_bounded(reader.uvarint, num_frames, "run_length", reader) + 1
            runs.append((first, count))
            end = first + count
            left -= count
        if left:
            raise CorruptBitstream("frame numbers do not add up to num_frames", offset=offset)
        return FrameNumbers(tuple(runs))


@dataclass(frozen=True)
class UnitExponents:
    """log2 of the unit of each grid of the state; value = state * 2**exponent (spec section 8).

    `origin` x, y, z in units of positions is added to these; `precision` is that of decoded positions.
    """

    position: int
    scale: int
    opacity: int
    color: int
    origin: tuple[int, int, int] = (0, 0, 0)
    precision: Precision = Precision.FLOAT32

    @property
    def from_origin(self) -> UnitExponents:
        """The grids of values whose positions are taken from the origin already."""
        return replace(self, origin=(0, 0, 0))

    @property
    def suit_networks(self) -> bool:
        """Whether attributes fit 64 bits in the units that networks know (spec section 4.1)."""
        low, high = _NETWORK_COLOR_EXPONENTS
        return self.scale <= _MAX_NETWORK_SCALE_EXPONENT and low <= self.color <= high

    def write(self, writer: ByteWriter) -> None:
        """Four exponents, the origin, the precision."""
        for value in (self.position, self.scale, self.opacity, self.color, *self.origin):
            writer.svarint(value)
        writer.u8(self.precision)

    @staticmethod
    def read(reader: ByteReader) -> UnitExponents:
        """Exponents beyond +-60 are refused, and an origin that sums could not hold."""
        offset = reader.offset
        values = [reader.svarint() for _ in range(4)]
        if max(map(abs, values)) > _MAX_UNIT_EXPONENT:
            raise LimitExceeded(f"unit exponents {values} exceed +-{_MAX_UNIT_EXPONENT}", offset=offset)
        if values[2] > MAX_OPACITY_EXPONENT:
            raise LimitExceeded(
                f"opacity unit exponent {values[2]} exceeds {MAX_OPACITY_EXPONENT}", offset=offset
            )
        origin = read_point(reader, MAX_ORIGIN, "position_origin")
        precision = read_enum(Precision, reader, "position_precision")
        position, scale, opacity, color = values
        return UnitExponents(position, scale, opacity, color, origin, precision)


@dataclass(frozen=True)
class SequenceHeader:
    """What holds for every frame (spec section 4)."""

    profile: Profile
    level: int
    sh_degree: int
    output_order: OutputOrder
    frame_rate: tuple[int, int]
    frame_numbers: FrameNumbers
    unit_exponents: UnitExponents
    model_id: str = ""
    model_hash: bytes = bytes(MODEL_HASH_BYTES)

    @property
    def num_frames(self) -> int:
        """Frames of the sequence."""
        return sum(count for _, count in self.frame_numbers.runs)

    @property
    def limits(self) -> LevelLimits:
        """Largest counts of the level."""
        return LEVELS[self.level]

    def write(self, writer: ByteWriter) -> None:
        """All fields in order."""
        for value in (BITSTREAM_VERSION, self.profile, self.level, self.sh_degree, self.output_order):
            writer.u8(value)
        writer.uvarint(self.num_frames)
        writer.uvarint(self.frame_rate[0])
        writer.uvarint(self.frame_rate[1])
        self.frame_numbers.write(writer)
        self.unit_exponents.write(writer)
        writer.uvarint(len(self.model_id))
        writer.raw(self.model_id.encode("ascii"))
        writer.raw(self.model_hash)

    @staticmethod
    def read(reader: ByteReader) -> SequenceHeader:
        """Refuses unknown versions, profiles and levels, and counts above the level."""
        offset = reader.offset
        version = reader.u8()
        if version != BITSTREAM_VERSION:
            raise UnsupportedBitstream(
                f"bitstream version {version}; this decoder reads version {BITSTREAM_VERSION}", offset=offset
            )
        profile = read_enum(Profile, reader, "profile")
        offset = reader.offset
        level = reader.u8()
        if level not in LEVELS:
            raise UnsupportedBitstream(f"level {level} is unknown", offset=offset)
        sh_degree = read_bounded(reader.u8, _MAX_SH_DEGREE, "sh_degree", reader)
        order = read_enum(OutputOrder, reader, "output_order")
        num_frames = read_bounded(reader.uvarint, LEVELS[level].max_frames, "num_frames", reader)
        offset = reader.offset
        rate = (reader.uvarint(), reader.uvarint())
        if num_frames == 0 or rate[1] == 0:
            raise CorruptBitstream("no frames, or a frame rate with denominator 0", offset=offset)
        numbers = FrameNumbers.read(reader, num_frames)
        offset = reader.offset
        units = UnitExponents.read(reader)
        if profile == Profile.PAPER and not units.suit_networks:
            raise LimitExceeded(f"unit exponents {units} are too far from 0 for a network", offset=offset)
        model_id, model_hash = _read_model(reader)
        return SequenceHeader(profile, level, sh_degree, order, rate, numbers, units, model_id, model_hash)


def _read_model(reader: ByteReader) -> tuple[str, bytes]:
    length = read_bounded(reader.uvarint, _MAX_MODEL_ID, "model_id length", reader)
    offset = reader.offset
    try:
        model_id = reader.raw(length).decode("ascii")
    except UnicodeDecodeError:
        raise CorruptBitstream("model_id is not ASCII", offset=offset) from None
    return model_id, reader.raw(MODEL_HASH_BYTES)
