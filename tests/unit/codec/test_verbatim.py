from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.intra.verbatim import (
    VerbatimSymbols,
    cloud_of_columns,
    code_float_column,
    code_verbatim,
    state_of,
)
from dfcgs_codec.codec.state.planes import verbatim_columns
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from lab.small_clouds import make_cloud, real_cloud, same_cloud
from tests.helpers import check_walk

UNITS = UnitExponents(-12, -12, -12, -12)
SPECIAL = [0.0, -0.0, 1e-45, -1e-45, 1.1754944e-38, 3.4028235e38, np.inf, -np.inf, np.nan, 1.0, -1.0]


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype == np.float32 and a.tobytes() == b.tobytes()


def check(column: np.ndarray) -> int:
    def code(coder: SymbolCoder, writing: bool) -> np.ndarray:
        found = code_float_column(coder, column if writing else None, len(column))
        assert same_bits(found, column)
        return found

    return check_walk(code, same_bits)


@given(hnp.arrays(np.uint32, st.integers(1, 80)))
def test_any_bit_pattern(bits: np.ndarray) -> None:
    check(bits.view(np.float32))


def test_special_values() -> None:
    check(np.array(SPECIAL, np.float32))
    check(np.repeat(np.array(SPECIAL, np.float32), 200))
    check(np.array([0x7FC00001, 0xFFC12345, 0x7F800001], np.uint32).view(np.float32))


def test_noise_costs_no_more_than_its_bytes() -> None:
    bits = np.random.default_rng(0).integers(0, 2**32, 4000, dtype=np.uint32)
    assert check(bits.view(np.float32)) <= 4 * 4000 + 16


@pytest.mark.parametrize("count", [1, 3, 20, 60, 200, 1000])
def test_no_column_costs_more_than_its_bytes(count: int) -> None:
    cloud = make_cloud(count)
    for column in (cloud.positions[:, 0], cloud.scales[:, 1], cloud.opacities):
        assert check(np.ascontiguousarray(column)) <= 4 * count + 16


def test_trained_values_cost_less_than_their_bytes() -> None:
    assert check(np.ascontiguousarray(real_cloud(4000).scales[:, 0])) < 0.9 * 4 * 4000


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("permuted", [False, True])
def test_whole_frames(degree: int, permuted: bool) -> None:
    cloud = make_cloud(70, degree)
    permutation = np.random.default_rng(0).permutation(70) if permuted else None
    symbols = VerbatimSymbols(verbatim_columns(cloud), permutation)
    widths = [STATE_COLUMNS[a] for a in coded_attributes(degree)]
    writers: list[SymbolWriter] = []

    def open_writer() -> SymbolWriter:
        writers.append(SymbolWriter())
        return writers[-1]

    written = code_verbatim(open_writer, symbols, widths, (70, permuted))
    assert len(writers) == len(widths) + permuted
    assert same_cloud(cloud_of_columns(written.columns), cloud)


@pytest.mark.parametrize("degree", range(4))
def test_columns_and_cloud_are_inverse(degree: int) -> None:
    cloud = make_cloud(9, degree)
    columns = verbatim_columns(cloud)
    assert [c.shape[1] for c in columns] == [STATE_COLUMNS[a] for a in coded_attributes(degree)]
    assert same_cloud(cloud_of_columns(columns), cloud)


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        (0, np.nan, [0, 0, 0]),
        (1, np.inf, [STATE_LIMIT] * 3),
        (1, -1e38, [-STATE_LIMIT] * 3),
        (5, np.nan, [0] * 9),
        (2, 0.0, [1 << 24, 0, 0, 0]),
        (2, np.inf, [1 << 24, 0, 0, 0]),
    ],
)
def test_values_without_a_place_on_the_grid_have_a_state(
    column: int, value: float, expected: list[int]
) -> None:
    columns = [values.copy() for values in verbatim_columns(make_cloud(6, 1))]
    columns[column][4] = value
    state = state_of(cloud_of_columns(columns), UNITS)
    assert list(state.planes.values())[column].values[4].tolist() == expected
    assert state.verbatim is not None
    assert verbatim_columns(state.verbatim)[column][4].tobytes() == columns[column][4].tobytes()


def test_the_state_is_the_frame_on_the_grids() -> None:
    cloud = make_cloud(200, 2)
    state = state_of(cloud, UNITS)
    half = 2.0**-13
    planes = {a: p.values * 2.0**-12 for a, p in state.planes.items()}
    assert np.abs(planes[Attribute.POSITION] - cloud.positions).max() <= half
    assert np.abs(planes[Attribute.SCALE] - cloud.scales).max() <= half
    assert np.abs(planes[Attribute.SH_DC] - cloud.sh_dc).max() <= half
    assert (
        np.abs(planes[Attribute.SH_1] - cloud.sh_rest[:, :, :3].transpose(0, 2, 1).reshape(200, 9)).max()
        <= half
    )
    assert state.verbatim is cloud


def test_values_beyond_the_state_are_clipped() -> None:
    cloud = make_cloud(2)
    far = replace(cloud, positions=np.full((2, 3), 3e38, np.float32))
    assert (state_of(far, UNITS).planes[Attribute.POSITION].values == STATE_LIMIT).all()
