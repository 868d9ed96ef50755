"""Header of a MOTION chunk, `write` beside `read` (spec section 6.3, spec annex B.2)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.constants import (
    MAX_DECAY_EXPONENT,
    MAX_LATENT_STEP_LOG2,
    MAX_NEIGHBOURS,
    MIN_LATENT_STEP_LOG2,
    STATE_LIMIT,
    STEREO_FRACTION_BITS,
)
from dfcgs_codec.bitstream.fields import read_bounded
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.errors import CorruptBitstream, LimitExceeded

#: what the streams of a MOTION chunk hold: who follows, and how control points move
FOLLOWERS, CONTROL_POINTS = "FOLLOWERS", "CONTROL_POINTS"


@dataclass(frozen=True)
class SpreadHeader:
    """How the motion of control points is spread over Gaussians.

    Each one's goes to its `num_neighbours` nearest Gaussians (K of the paper); `decay_exponent` is the log2
    of the width of a cell, in the distance over which the share fades by e.
    """

    num_neighbours: int
    decay_exponent: int

    def write(self, writer: ByteWriter) -> None:
        """Both fields."""
        writer.uvarint(self.num_neighbours)
        writer.svarint(self.decay_exponent)

    @staticmethod
    def read(reader: ByteReader) -> SpreadHeader:
        """Refuses no neighbours or too many, and exponents beyond +-28."""
        offset = reader.offset
        count = read_bounded(reader.uvarint, MAX_NEIGHBOURS, "num_neighbours", reader)
        if count == 0:
            raise CorruptBitstream("num_neighbours is 0", offset=offset)
        offset = reader.offset
        exponent = reader.svarint()
        if abs(exponent) > MAX_DECAY_EXPONENT:
            raise LimitExceeded(f"decay_exponent {exponent} exceeds +-{MAX_DECAY_EXPONENT}", offset=offset)
        return SpreadHeader(count, exponent)


@dataclass(frozen=True)
class MotionHeader:
    """Steps of the control points' motion.

    Those of translations are in grid units, those of turns in 2**-18 of a turn vector; 0: nothing turns.
    """

    translation_step: int
    turn_step: int

    @property
    def is_rigid(self) -> bool:
        """Whether rotations move, too."""
        return self.turn_step > 0

    @property
    def num_columns(self) -> int:
        """Symbols of a control point."""
        return 6 if self.is_rigid else 3

    def streams(self, sh_degree: int) -> list[str]:
        """What its streams hold, in their order."""
        return [FOLLOWERS, CONTROL_POINTS]

    def write(self, writer: ByteWriter) -> None:
        """Both fields."""
        writer.uvarint(self.translation_step)
        writer.uvarint(self.turn_step)

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> MotionHeader:
        """Refuses steps beyond their grids, and a translation step of 0."""
        offset = reader.offset
        translation = read_bounded(reader.uvarint, STATE_LIMIT, "translation_step", reader)
        if translation == 0:
            raise CorruptBitstream("translation_step is 0", offset=offset)
        return MotionHeader(
            translation, read_bounded(reader.uvarint, 1 << STEREO_FRACTION_BITS, "turn_step", reader)
        )


@dataclass(frozen=True)
class LatentHeader:
    """How latents of `num_coded` control points are quantised, by 2**`step_log2`, and motion is spread.

    MOTION chunk of profile PAPER (spec annex B.2).
    """

    num_coded: int
    step_log2: int
    spread: SpreadHeader

    def write(self, writer: ByteWriter) -> None:
        """All fields in order."""
        writer.uvarint(self.num_coded)
        writer.svarint(self.step_log2)
        self.spread.write(writer)

    def streams(self, sh_degree: int) -> None:
        """One stream fills the rest."""

    @staticmethod
    def read(reader: ByteReader, sequence: SequenceHeader) -> LatentHeader:
        """Refuses steps out of range."""
        count = reader.uvarint()
        offset = reader.offset
        step_log2 = reader.svarint()
        if not MIN_LATENT_STEP_LOG2 <= step_log2 <= MAX_LATENT_STEP_LOG2:
            raise LimitExceeded(f"latent_step_log2 is {step_log2}", offset=offset)
        return LatentHeader(count, step_log2, SpreadHeader.read(reader))
