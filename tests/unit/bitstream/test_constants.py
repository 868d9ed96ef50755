from __future__ import annotations

import itertools

from dfcgs_codec.bitstream.constants import (
    ANCILLARY_BIT,
    BITSTREAM_VERSION,
    LEVELS,
    MAGIC,
    STATE_COLUMNS,
    STATE_LIMIT,
    Attribute,
    ChunkType,
)


def test_magic_shows_damage_by_text_mode_and_seven_bit_transfers() -> None:
    assert MAGIC == b"\x89DGS\r\n\x1a\n"
    assert BITSTREAM_VERSION == 11


def test_what_may_be_skipped() -> None:
    assert [t for t in ChunkType if t & ANCILLARY_BIT] == [ChunkType.ENCODER_INFO, ChunkType.PLY_COMMENTS]


def test_levels_grow() -> None:
    for lower, higher in itertools.pairwise(LEVELS.values()):
        assert lower.max_gaussians < higher.max_gaussians
        assert lower.max_frames < higher.max_frames


def test_every_attribute_has_columns_and_a_mask_bit() -> None:
    assert sorted(STATE_COLUMNS) == list(Attribute) == list(range(8))
    assert sum(STATE_COLUMNS.values()) == 59


def test_state_integers_and_their_differences_fit_int32() -> None:
    assert 2 * STATE_LIMIT < 2**31
