"""Every syntax structure: random legal instance -> bytes -> equal, and all bytes are used."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import (
    BITSTREAM_VERSION,
    LEVELS,
    MAX_COARSE_LOG2,
    MAX_CONTROL_SHIFT,
    MAX_DECAY_EXPONENT,
    MAX_LATENT_STEP_LOG2,
    MAX_NEIGHBOURS,
    MAX_OPACITY_EXPONENT,
    MAX_SORT_BITS,
    MAX_SORT_SHIFT,
    MAX_THIN_EXPONENT,
    MAX_THIN_OCTAVES,
    MIN_LATENT_STEP_LOG2,
    PROFILE_TOOLS,
    STATE_LIMIT,
    STEREO_FRACTION_BITS,
    Attribute,
    IntraKind,
    OutputOrder,
    Profile,
    Tool,
)
from dfcgs_codec.bitstream.frame_headers import (
    ControlHeader,
    InterHeader,
    IntraHeader,
    IntraSteps,
    SortGrid,
    coded_attributes,
)
from dfcgs_codec.bitstream.index import End, Index, IndexEntry
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.motion_header import LatentHeader, MotionHeader, SpreadHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.errors import BitstreamError, CorruptBitstream, LimitExceeded, UnsupportedBitstream

UINT32 = st.integers(0, 2**32 - 1)
LENGTHS = st.integers(0, 2**64 - 1)
STEPS = st.integers(1, STATE_LIMIT)
HASHES = st.binary(min_size=16, max_size=16)
DEGREES = st.integers(0, 3)
SMALL = SequenceHeader(
    Profile.MAIN,
    1,
    2,
    OutputOrder.FREE,
    (30, 1),
    FrameNumbers(((0, 6),)),
    UnitExponents(-10, -12, -12, -12),
)


PAPER = replace(SMALL, profile=Profile.PAPER, model_id="paper", model_hash=bytes(8))


@st.composite
def frame_numbers(draw: st.DrawFn) -> FrameNumbers:
    runs, end = [], 0
    for index in range(draw(st.integers(1, 5))):
        first = end + draw(st.integers(1 if index else 0, 1000))
        count = draw(st.integers(1, 50))
        runs.append((first, count))
        end = first + count
    return FrameNumbers(tuple(runs))


WIDE = st.integers(-60, 60)
EXPONENTS = st.builds(UnitExponents, WIDE, WIDE, st.integers(-60, MAX_OPACITY_EXPONENT), WIDE)
NETWORK_EXPONENTS = st.builds(
    UnitExponents, WIDE, st.integers(-60, 23), st.integers(-60, MAX_OPACITY_EXPONENT), st.integers(-40, 21)
)
MODELS = st.tuples(st.text(st.characters(codec="ascii"), max_size=64), st.binary(min_size=8, max_size=8))


@st.composite
def sequence_headers(draw: st.DrawFn) -> SequenceHeader:
    profile = draw(st.sampled_from(Profile))
    return SequenceHeader(
        profile,
        draw(st.sampled_from(sorted(LEVELS))),
        draw(DEGREES),
        draw(st.sampled_from(OutputOrder)),
        (draw(UINT32), draw(st.integers(1, 2**32 - 1))),
        draw(frame_numbers()),
        draw(EXPONENTS if profile == Profile.MAIN else NETWORK_EXPONENTS),
        *draw(MODELS),
    )


ORIGINS = st.integers(-STATE_LIMIT, STATE_LIMIT)
INTRA_STEPS = st.builds(
    IntraSteps,
    st.fixed_dictionaries(dict.fromkeys(coded_attributes(SMALL.sh_degree), STEPS)),
    st.integers(0, MAX_COARSE_LOG2),
    st.fixed_dictionaries(dict.fromkeys(coded_attributes(SMALL.sh_degree), st.integers(-900, STATE_LIMIT))),
    st.integers(0, MAX_THIN_OCTAVES),
    st.frozensets(st.sampled_from(coded_attributes(SMALL.sh_degree)[1:])),
)
SORT_GRIDS = st.builds(
    SortGrid,
    st.integers(0, MAX_SORT_SHIFT),
    st.integers(0, MAX_SORT_BITS),
    st.tuples(ORIGINS, ORIGINS, ORIGINS),
    st.booleans(),
)


CONTROLS = st.builds(
    ControlHeader,
    st.integers(1, STATE_LIMIT),
    st.integers(0, MAX_CONTROL_SHIFT),
)
MOTION_HEADERS = st.builds(
    MotionHeader,
    st.integers(1, STATE_LIMIT),
    st.integers(0, 1 << STEREO_FRACTION_BITS),
)
SPREAD_HEADERS = st.builds(
    SpreadHeader, st.integers(1, MAX_NEIGHBOURS), st.integers(-MAX_DECAY_EXPONENT, MAX_DECAY_EXPONENT)
)
LATENT_HEADERS = st.builds(
    LatentHeader,
    st.integers(0, 2**40),
    st.integers(MIN_LATENT_STEP_LOG2, MAX_LATENT_STEP_LOG2),
    SPREAD_HEADERS,
)


@st.composite
def intra_headers(draw: st.DrawFn) -> IntraHeader:
    kind = draw(st.sampled_from(IntraKind))
    permuted = draw(st.booleans())
    coded, control = kind == IntraKind.CODED, draw(CONTROLS)
    most = min(SMALL.limits.max_gaussians, SMALL.limits.max_control_points * control.spacing)
    return IntraHeader(
        draw(HASHES),
        kind,
        draw(st.integers(1, most)),
        permuted,
        control,
        draw(SORT_GRIDS) if coded else None,
        draw(INTRA_STEPS) if coded else None,
    )


@st.composite
def inter_headers(draw: st.DrawFn) -> InterHeader:
    present = draw(st.sets(st.sampled_from(coded_attributes(SMALL.sh_degree))))
    choice = st.sets(st.sampled_from(sorted(PROFILE_TOOLS[Profile.MAIN])))
    tools = frozenset(draw(choice)) - (frozenset() if present else {Tool.VISIBILITY})
    levels = sorted(present) if Tool.VISIBILITY in tools else []
    visibility = {a: draw(st.integers(-STATE_LIMIT, STATE_LIMIT)) for a in levels}
    return InterHeader(draw(HASHES), tools, {a: draw(STEPS) for a in sorted(present)}, visibility)


PAPER_INTER_HEADERS = st.builds(
    InterHeader,
    HASHES,
    st.frozensets(st.sampled_from(sorted(PROFILE_TOOLS[Profile.PAPER]))),
    st.just({}),
)


@st.composite
def indices(draw: st.DrawFn) -> Index:
    cuts = draw(st.sets(st.integers(1, SMALL.num_frames - 1)))
    bounds = [0, *sorted(cuts), SMALL.num_frames]
    entries, offset = [], 0
    for first, end in itertools.pairwise(bounds):
        offset += draw(st.integers(0, 2**40))
        entries.append(IndexEntry(first, end - first, offset))
    return Index(tuple(entries))


STRUCTURES: dict[str, tuple[st.SearchStrategy[Any], Callable[[ByteReader, Any], Any]]] = {
    "FrameNumbers": (frame_numbers(), lambda r, x: FrameNumbers.read(r, len(x.expand()))),
    "UnitExponents": (EXPONENTS, lambda r, _: UnitExponents.read(r)),
    "SequenceHeader": (sequence_headers(), lambda r, _: SequenceHeader.read(r)),
    "SortGrid": (SORT_GRIDS, lambda r, _: SortGrid.read(r)),
    "IntraHeader": (intra_headers(), lambda r, _: IntraHeader.read(r, SMALL)),
    "InterHeader": (inter_headers(), lambda r, _: InterHeader.read(r, SMALL)),
    "PaperInterHeader": (PAPER_INTER_HEADERS, lambda r, _: InterHeader.read(r, PAPER)),
    "LatentHeader": (LATENT_HEADERS, lambda r, _: LatentHeader.read(r, SMALL)),
    "SpreadHeader": (SPREAD_HEADERS, lambda r, _: SpreadHeader.read(r)),
    "MotionHeader": (MOTION_HEADERS, lambda r, _: MotionHeader.read(r, SMALL)),
    "Index": (indices(), lambda r, _: Index.read(r, SMALL)),
    "End": (st.builds(End, LENGTHS), lambda r, _: End.read(r)),
}


def write(structure: Any) -> bytes:
    writer = ByteWriter()
    structure.write(writer)
    return writer.getvalue()


@pytest.mark.parametrize("name", STRUCTURES)
@given(data=st.data())
def test_round_trip_uses_all_bytes(name: str, data: st.DataObject) -> None:
    instances, read = STRUCTURES[name]
    instance = data.draw(instances)
    reader = ByteReader(write(instance))
    assert read(reader, instance) == instance
    reader.expect_end(name)


@pytest.mark.parametrize("name", STRUCTURES)
@given(data=st.data())
def test_every_prefix_is_short(name: str, data: st.DataObject) -> None:
    instances, read = STRUCTURES[name]
    instance = data.draw(instances)
    whole = write(instance)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(BitstreamError) as caught:
        read(ByteReader(whole[:cut]), instance)
    assert caught.value.code == "truncated"


@pytest.mark.parametrize("name", STRUCTURES)
@given(data=st.data())
def test_garbage_is_read_or_refused_and_nothing_else(name: str, data: st.DataObject) -> None:
    instances, read = STRUCTURES[name]
    instance = data.draw(instances)
    garbage = data.draw(st.binary(max_size=64))
    with contextlib.suppress(BitstreamError):
        read(ByteReader(garbage), instance)


# --- FrameNumbers -------------------------------------------------------------------------------------


@given(st.sets(st.integers(0, 500), min_size=1))
def test_frame_numbers_of_any_set(numbers: set[int]) -> None:
    runs = FrameNumbers.of(sorted(numbers))
    assert runs.expand() == sorted(numbers)
    assert all(b[0] > a[0] + a[1] for a, b in itertools.pairwise(runs.runs))


@pytest.mark.parametrize("num_frames", [5, 7])
def test_frame_numbers_must_add_up(num_frames: int) -> None:
    with pytest.raises(CorruptBitstream, match="do not add up"):
        FrameNumbers.read(ByteReader(write(FrameNumbers(((0, 6),)))), num_frames)


def test_more_runs_than_frames_are_refused() -> None:
    with pytest.raises(LimitExceeded, match="num_runs"):
        FrameNumbers.read(ByteReader(b"\x07" + bytes(20)), 6)


# --- SequenceHeader -----------------------------------------------------------------------------------


def header_bytes(position: int, value: int) -> ByteReader:
    data = bytearray(write(SMALL))
    data[position] = value
    return ByteReader(bytes(data))


@pytest.mark.parametrize(
    ("position", "value", "error", "words"),
    [
        (0, BITSTREAM_VERSION + 1, UnsupportedBitstream, "version"),
        (1, 2, UnsupportedBitstream, "profile"),
        (2, 0, UnsupportedBitstream, "level"),
        (2, 4, UnsupportedBitstream, "level"),
        (3, 4, LimitExceeded, "sh_degree"),
        (4, 3, UnsupportedBitstream, "output_order"),
        (5, 0, CorruptBitstream, "no frames"),
        (7, 0, CorruptBitstream, "frame rate"),
    ],
)
def test_sequence_header_refuses(position: int, value: int, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        SequenceHeader.read(header_bytes(position, value))


def test_sequence_header_refuses_more_frames_than_the_level_has() -> None:
    numbers = FrameNumbers(((0, LEVELS[1].max_frames + 1),))
    header = SequenceHeader(Profile.MAIN, 1, 0, OutputOrder.FREE, (30, 1), numbers, UnitExponents(0, 0, 0, 0))
    with pytest.raises(LimitExceeded, match="num_frames"):
        SequenceHeader.read(ByteReader(write(header)))


@pytest.mark.parametrize("exponents", [(61, 0, -12, 0), (0, -61, -12, 0), (0, 0, -61, 0), (0, 0, -12, 61)])
def test_unit_exponents_beyond_60_are_refused(exponents: tuple[int, int, int, int]) -> None:
    with pytest.raises(LimitExceeded, match="exponents"):
        UnitExponents.read(ByteReader(write(UnitExponents(*exponents))))


def test_an_opacity_unit_that_does_not_divide_the_knots_is_refused() -> None:
    with pytest.raises(LimitExceeded, match="opacity"):
        UnitExponents.read(ByteReader(write(UnitExponents(0, 0, MAX_OPACITY_EXPONENT + 1, 0))))


def test_model_id_must_be_ascii_and_short() -> None:
    without = write(SMALL)[:-9]
    with pytest.raises(CorruptBitstream, match="ASCII"):
        SequenceHeader.read(ByteReader(without + b"\x01\xff" + bytes(8)))
    with pytest.raises(LimitExceeded, match="model_id length"):
        SequenceHeader.read(ByteReader(without + b"\x41" + b"a" * 65 + bytes(8)))


# --- frame headers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grid", "words"),
    [
        (SortGrid(MAX_SORT_SHIFT + 1, 0, (0, 0, 0), False), "sort_shift"),
        (SortGrid(0, MAX_SORT_BITS + 1, (0, 0, 0), False), "sort_bits"),
        (SortGrid(0, 0, (0, 0, STATE_LIMIT + 1), False), "sort_origin"),
        (SortGrid(0, 0, (0, -STATE_LIMIT - 1, 0), False), "sort_origin"),
    ],
)
def test_sort_grid_out_of_range(grid: SortGrid, words: str) -> None:
    with pytest.raises(LimitExceeded, match=words):
        SortGrid.read(ByteReader(write(grid)))


def test_flags_are_0_or_1() -> None:
    data = bytearray(write(SortGrid(0, 3, (1, 2, 3), True)))
    data[-1] = 2
    with pytest.raises(LimitExceeded, match="has_excess"):
        SortGrid.read(ByteReader(bytes(data)))


LEVELS_OF_TWO = dict.fromkeys(coded_attributes(2), 0)
INTRA = IntraSteps(dict.fromkeys(coded_attributes(2), 5), 0, LEVELS_OF_TWO, 0, frozenset())


def intra_header(**changes: Any) -> IntraHeader:
    fields = {
        "frame_hash": bytes(16),
        "kind": IntraKind.CODED,
        "num_gaussians": 10,
        "has_permutation": False,
        "control": ControlHeader(70, 6),
        "sort_grid": SortGrid(0, 3, (0, 0, 0), False),
        "steps": INTRA,
    }
    return IntraHeader(**(fields | changes))


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"num_gaussians": SMALL.limits.max_gaussians + 1}, LimitExceeded, "num_gaussians"),
        ({"steps": replace(INTRA, steps=LEVELS_OF_TWO)}, CorruptBitstream, "step is 0"),
        (
            {"steps": replace(INTRA, steps=dict.fromkeys(coded_attributes(2), STATE_LIMIT + 1))},
            LimitExceeded,
            "step",
        ),
        ({"kind": 7}, UnsupportedBitstream, "intra_kind"),
        ({"has_permutation": 2}, LimitExceeded, "has_permutation"),
        ({"control": ControlHeader(0, 6)}, CorruptBitstream, "control_spacing is 0"),
        ({"control": ControlHeader(9, 32)}, LimitExceeded, "control_shift"),
        (
            {"steps": replace(INTRA, thin_octaves=MAX_THIN_OCTAVES + 1)},
            LimitExceeded,
            "thin_octaves",
        ),
        (
            {"steps": replace(INTRA, coarse_log2=MAX_COARSE_LOG2 + 1)},
            LimitExceeded,
            "coarse_log2",
        ),
        (
            {"steps": replace(INTRA, levels=LEVELS_OF_TWO | {Attribute.SH_2: STATE_LIMIT + 1})},
            LimitExceeded,
            "visibility_level",
        ),
        (
            {"steps": replace(INTRA, alternating=frozenset({Attribute.POSITION}))},
            CorruptBitstream,
            "alternating",
        ),
        (
            {"steps": replace(INTRA, alternating=frozenset({Attribute.SH_3}))},
            CorruptBitstream,
            "alternating",
        ),
    ],
)
def test_intra_header_refuses(changes: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        IntraHeader.read(ByteReader(write(intra_header(**changes))), SMALL)


def test_thin_axes_need_a_grid_that_octaves_can_be_told_on() -> None:
    data = write(intra_header(steps=replace(INTRA, thin_octaves=1)))
    for exponent, is_fine in ((MAX_THIN_EXPONENT, True), (MAX_THIN_EXPONENT + 1, False)):
        sequence = replace(SMALL, unit_exponents=replace(SMALL.unit_exponents, scale=exponent))
        with nullcontext() if is_fine else pytest.raises(CorruptBitstream, match="thin axes"):
            IntraHeader.read(ByteReader(data), sequence)


def test_inter_header_refuses_attributes_that_the_sequence_lacks() -> None:
    with pytest.raises(CorruptBitstream, match="attribute_mask"):
        InterHeader.read(ByteReader(bytes(16) + b"\x00\x80\x06\x05"), SMALL)


def test_inter_header_refuses_visibility_without_attributes() -> None:
    with pytest.raises(CorruptBitstream, match="VISIBILITY"):
        InterHeader.read(ByteReader(bytes(16) + b"\x04\x00\x06"), SMALL)


@pytest.mark.parametrize("sign", [-1, 1])
def test_inter_header_refuses_levels_beyond_the_state(sign: int) -> None:
    levels = {Attribute.SCALE: sign * (STATE_LIMIT + 1)}
    header = InterHeader(bytes(16), frozenset({Tool.VISIBILITY}), {Attribute.SCALE: 5}, levels)
    with pytest.raises(LimitExceeded, match="visibility_level"):
        InterHeader.read(ByteReader(write(header)), SMALL)


@pytest.mark.parametrize(
    ("sequence", "data"),
    [
        (SMALL, (8, 0, 6)),
        (SMALL, (16, 0, 6)),
        (PAPER, (1, 0)),
        (PAPER, (4, 1)),
        (PAPER, (0, 1)),
        (PAPER, (2, 0)),
    ],
)
def test_inter_header_refuses_what_the_profile_does_not_have(
    sequence: SequenceHeader, data: tuple[int, ...]
) -> None:
    with pytest.raises(CorruptBitstream, match=sequence.profile.name):
        InterHeader.read(ByteReader(bytes(16) + bytes((*data, 5, 5, 5))), sequence)


@pytest.mark.parametrize(
    ("changes", "fine"),
    [
        ({}, True),
        ({"scale": 23, "color": 21}, True),
        ({"color": -40}, True),
        ({"scale": 24}, False),
        ({"color": 22}, False),
        ({"color": -41}, False),
    ],
)
def test_units_that_networks_cannot_take(changes: dict[str, int], fine: bool) -> None:
    units = replace(SMALL.unit_exponents, **changes)
    assert (
        SequenceHeader.read(ByteReader(write(replace(SMALL, unit_exponents=units)))).unit_exponents == units
    )
    data = write(replace(PAPER, unit_exponents=units))
    if fine:
        assert SequenceHeader.read(ByteReader(data)).unit_exponents == units
    else:
        with pytest.raises(LimitExceeded, match="network"):
            SequenceHeader.read(ByteReader(data))


@pytest.mark.parametrize("step_log2", [MIN_LATENT_STEP_LOG2 - 1, MAX_LATENT_STEP_LOG2 + 1])
def test_latent_header_refuses_steps(step_log2: int) -> None:
    header = LatentHeader(10, step_log2, SpreadHeader(30, 2))
    with pytest.raises(LimitExceeded, match="latent_step_log2"):
        LatentHeader.read(ByteReader(write(header)), SMALL)


def test_inter_header_refuses_unknown_tools() -> None:
    with pytest.raises(UnsupportedBitstream, match="tools 0x80"):
        InterHeader.read(ByteReader(bytes(16) + bytes((0x80, 0, 6))), SMALL)


def test_a_frame_that_repeats_its_reference_takes_18_bytes() -> None:
    assert len(write(InterHeader(bytes(16), frozenset(), {}))) == 18


# --- MotionHeader -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "error", "words"),
    [
        (MotionHeader(0, 2), CorruptBitstream, "translation_step is 0"),
        (MotionHeader(STATE_LIMIT + 1, 2), LimitExceeded, "translation_step"),
        (MotionHeader(4, (1 << STEREO_FRACTION_BITS) + 1), LimitExceeded, "turn_step"),
    ],
)
def test_motion_header_refuses(header: MotionHeader, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        MotionHeader.read(ByteReader(write(header)), SMALL)


@pytest.mark.parametrize(
    ("spread", "error", "words"),
    [
        (SpreadHeader(MAX_NEIGHBOURS + 1, 0), LimitExceeded, "num_neighbours"),
        (SpreadHeader(0, 0), CorruptBitstream, "num_neighbours is 0"),
        (SpreadHeader(30, -MAX_DECAY_EXPONENT - 1), LimitExceeded, "decay_exponent"),
    ],
)
def test_spread_header_refuses(spread: SpreadHeader, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        LatentHeader.read(ByteReader(write(LatentHeader(5, 0, spread))), SMALL)


# --- Index --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entries", "error"),
    [
        ((), CorruptBitstream),
        ((IndexEntry(0, 5, 10),), CorruptBitstream),
        ((IndexEntry(0, 7, 10),), CorruptBitstream),
        ((IndexEntry(0, 6, 10), IndexEntry(6, 0, 20)), CorruptBitstream),
        (tuple(IndexEntry(i, 1, i) for i in range(7)), LimitExceeded),
    ],
)
def test_index_must_cover_the_sequence(entries: tuple[IndexEntry, ...], error: type[Exception]) -> None:
    with pytest.raises(error):
        Index.read(ByteReader(write(Index(entries))), SMALL)
