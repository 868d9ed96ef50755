"""Header of a MOTION chunk, `write` beside `read` (spec section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.bitstream.constants import MAX_TEMPORAL_WEIGHT, STATE_LIMIT, STEREO_FRACTION_BITS
from dfcgs_codec.bitstream.fields import read_bounded
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.errors import CorruptBitstream


@dataclass(frozen=True)
class MotionHeader:
    """How the control points' motion is coded.

    `num_coded` control points have symbols; `temporal_weight` quarters of what the last motion added to its
    prediction are expected again; steps are in grid units and in 2**-18 of a turn vector, 0 where control
    points only shift.
    """

    num_coded: int
    temporal_weight: int
    translation_step: int
    turn_step: int

    @property
    def is_rigid(self) -> bool:
        """Whether control points turn, too."""
        return self.turn_step > 0

    def write(self, writer: ByteWriter) -> None:
        """All fields in order."""
        writer.uvarint(self.num_coded)
        writer.u8(self.temporal_weight)
        writer.uvarint(self.translation_step)
        writer.uvarint(self.turn_step)

    @staticmethod
    def read(reader: ByteReader, num_points: int) -> MotionHeader:
        """Refuses more coded control points than the GoF has, and a translation step of 0."""
        num_coded = read_bounded(reader.uvarint, num_points, "num_coded", reader)
        weight = read_bounded(reader.u8, MAX_TEMPORAL_WEIGHT, "temporal_weight", reader)
        offset = reader.offset
        translation = read_bounded(reader.uvarint, STATE_LIMIT, "translation_step", reader)
        if translation == 0:
            raise CorruptBitstream("translation_step is 0", offset=offset)
        turn = read_bounded(reader.uvarint, 1 << STEREO_FRACTION_BITS, "turn_step", reader)
        return MotionHeader(num_coded, weight, translation, turn)
