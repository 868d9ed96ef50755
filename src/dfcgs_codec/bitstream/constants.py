"""Numbers of the format, as in bitstream_spec.md; changing one is a new bitstream version."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

MAGIC = b"\x89DGS\r\n\x1a\n"
#: first bytes of another package's `.dgs` files (dgs-py: one static scene with linear velocities)
FOREIGN_MAGIC = b"glps"
BITSTREAM_VERSION = 11

#: chunk types with this bit set may be skipped when unknown
ANCILLARY_BIT = 0x80
FRAME_HASH_BYTES = 16
MODEL_HASH_BYTES = 8
CRC_BYTES = 4

#: state integers stay inside +-(2**29 - 1), so that the output process is exact
STATE_LIMIT = (1 << 29) - 1
#: largest magnitude of the origin of positions, in grid units, so that sums are exact in float64
MAX_ORIGIN = 1 << 52
#: fraction bits of the unit quaternion of the state
ROTATION_FRACTION_BITS = 24
#: fraction bits of the stereographic rotation vector that rotation symbols scale
STEREO_FRACTION_BITS = 18
#: the unit of the opacity grid divides the distances of the companding knots by 2**7
MAX_OPACITY_EXPONENT = -11
#: the sort key holds this many bits per axis at most
MAX_SORT_BITS = 21
MAX_SORT_SHIFT = 31
#: octaves by which positions of an I-frame are coarser than their step at most
MAX_COARSE_LOG2 = 8
#: largest `thin_octaves`, and the coarsest grid of log-scales that octaves are told on
MAX_THIN_OCTAVES = 8
MAX_THIN_EXPONENT = -11
#: a GoF has at most this many control points, so that a decoder's work stays bounded
MAX_CONTROL_POINTS = 1 << 14
#: log2 of the grid units of a cell that control points are chosen on
MAX_CONTROL_SHIFT = 31
#: Gaussians that a control point's motion is spread over
MAX_NEIGHBOURS = 128
#: log2 of the step q' of motion latents
MIN_LATENT_STEP_LOG2, MAX_LATENT_STEP_LOG2 = -4, 6
#: largest magnitude of the log2 of the width of a cell, in the distance over which motion fades by e
MAX_DECAY_EXPONENT = 28


class ChunkType(IntEnum):
    """Kinds of chunks (spec section 3)."""

    SEQUENCE_HEADER = 0x01
    INTRA_FRAME = 0x10
    INTER_FRAME = 0x20
    HYPERPRIOR = 0x21
    MOTION = 0x22
    TOPOLOGY = 0x23
    RESIDUAL = 0x24
    ESCAPES = 0x25
    INDEX = 0x7E
    END = 0x7F
    ENCODER_INFO = 0x81
    PLY_COMMENTS = 0x82


#: those that frames are made of
FRAME_CHUNKS = frozenset(kind for kind in ChunkType if ChunkType.INTRA_FRAME <= kind <= ChunkType.ESCAPES)


class Profile(IntEnum):
    """Which prediction tools a stream may use (spec section 4)."""

    MAIN = 0
    PAPER = 1


class OutputOrder(IntEnum):
    """Order of the Gaussians in decoded frames (spec section 4)."""

    FREE = 0
    SEQUENCE = 1
    INPUT = 2


class Precision(IntEnum):
    """Width of decoded positions (spec section 4)."""

    FLOAT32 = 0
    FLOAT64 = 1


class IntraKind(IntEnum):
    """How an I-frame is stored (spec section 5)."""

    PLY = 0
    CODED = 1


class Tool(IntEnum):
    """What a P-frame may hold besides residuals; the value is the bit in `tools` (spec section 6.1)."""

    MOTION = 0
    TOPOLOGY = 1
    VISIBILITY = 2
    LATENT = 3
    REFINEMENT = 4
    ESCAPE = 5


class Attribute(IntEnum):
    """Attributes in coding order; the value is the bit in `attribute_mask`."""

    POSITION = 0
    SCALE = 1
    ROTATION = 2
    OPACITY = 3
    SH_DC = 4
    SH_1 = 5
    SH_2 = 6
    SH_3 = 7


#: integers per Gaussian in the state, by attribute
STATE_COLUMNS = {
    Attribute.POSITION: 3,
    Attribute.SCALE: 3,
    Attribute.ROTATION: 4,
    Attribute.OPACITY: 1,
    Attribute.SH_DC: 3,
    Attribute.SH_1: 9,
    Attribute.SH_2: 15,
    Attribute.SH_3: 21,
}


#: tools that P-frames of a profile may use
PROFILE_TOOLS = {
    Profile.MAIN: frozenset({Tool.MOTION, Tool.TOPOLOGY, Tool.VISIBILITY, Tool.ESCAPE}),
    Profile.PAPER: frozenset({Tool.LATENT, Tool.REFINEMENT, Tool.ESCAPE}),
}


class LevelLimits(NamedTuple):
    """Largest counts that a stream of a level may hold."""

    max_gaussians: int
    max_frames: int
    max_control_points: int


LEVELS = {
    1: LevelLimits(1 << 18, 1 << 14, 1 << 12),
    2: LevelLimits(1 << 21, 1 << 17, 1 << 14),
    3: LevelLimits(1 << 24, 1 << 20, 1 << 14),
}
