from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import coded_attributes
from dfcgs_codec.codec.intra import IntraShape, IntraSymbols, code_intra, code_permutation
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.codec.verbatim import state_of
from dfcgs_codec.encoder.analysis import intra_symbols, order_of, plan_grid
from dfcgs_codec.encoder.rate_control import plan_quantisation
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.lod import order_levels
from dfcgs_codec.transform.rotation import round_divide
from tests.helpers import clustered_cloud, make_cloud, real_cloud


def symbols_of(cloud: GaussianCloud, *, permuted: bool = False) -> tuple[IntraSymbols, IntraShape]:
    """Symbols of a cloud at medium quality."""
    quantisation = plan_quantisation(28, (), cloud)
    planes = {a: p.wide() for a, p in state_of(cloud, quantisation.units).planes.items()}
    indices = round_divide(planes[Attribute.POSITION], quantisation.steps[Attribute.POSITION])
    grid = plan_grid(indices)
    order = order_of(indices, grid)
    ordered = {a: values[order] for a, values in planes.items()}
    symbols = intra_symbols(ordered, quantisation.steps, order if permuted else None)
    return symbols, IntraShape(len(order), coded_attributes(cloud.sh_degree), permuted, grid)


def write(symbols: IntraSymbols, shape: IntraShape) -> list[bytes]:
    writers: list[SymbolWriter] = []

    def open_writer() -> SymbolWriter:
        writers.append(SymbolWriter())
        return writers[-1]

    code_intra(open_writer, symbols, shape)
    return [writer.getvalue() for writer in writers]


def read(streams: list[bytes], shape: IntraShape) -> IntraSymbols:
    readers = [SymbolReader(stream) for stream in streams]
    rest = iter(readers)
    found = code_intra(lambda: next(rest), None, shape)
    for reader in readers:
        reader.finish()
    return found


def same(a: IntraSymbols, b: IntraSymbols) -> bool:
    planes = all(np.array_equal(a.planes[k], b.planes[k]) for k in a.planes)
    return planes and list(a.planes) == list(b.planes) and np.array_equal(a.permutation, b.permutation)


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("count", [1, 2, 33, 400])
def test_round_trip(degree: int, count: int) -> None:
    for permuted in (False, True):
        symbols, shape = symbols_of(make_cloud(count, degree), permuted=permuted)
        streams = write(symbols, shape)
        assert len(streams) == 5 + degree + permuted
        assert same(read(streams, shape), symbols)


@settings(max_examples=25)
@given(st.integers(1, 60), st.integers(0, 1), st.integers(0, 10**6))
def test_any_cloud(count: int, degree: int, seed: int) -> None:
    symbols, shape = symbols_of(make_cloud(count, degree, seed), permuted=bool(seed % 2))
    assert same(read(write(symbols, shape), shape), symbols)


def test_wide_symbols_survive() -> None:
    symbols, shape = symbols_of(make_cloud(40, 1))
    rng = np.random.default_rng(0)
    for attribute in (Attribute.SCALE, Attribute.OPACITY, Attribute.SH_DC, Attribute.SH_1):
        like = symbols.planes[attribute]
        symbols.planes[attribute] = rng.integers(-(2**29) + 1, 2**29, like.shape)
    assert same(read(write(symbols, shape), shape), symbols)


def test_structure_is_cheaper_than_noise() -> None:
    clustered, noise = clustered_cloud(1500, 1), make_cloud(1500, 1)
    assert sum(map(len, write(*symbols_of(clustered)))) < 0.8 * sum(map(len, write(*symbols_of(noise))))


def test_a_trained_frame_takes_less_than_a_fifth_of_its_ply() -> None:
    cloud = real_cloud(2000)
    assert sum(map(len, write(*symbols_of(cloud)))) < 2000 * 4 * 38 / 5


def test_attributes_before_positions_do_not_matter_for_each_other() -> None:
    """Each attribute has its own stream; a change of colour leaves the others as they were."""
    cloud = make_cloud(200, 1)
    before = write(*symbols_of(cloud))
    after = write(*symbols_of(replace(cloud, sh_rest=cloud.sh_rest + np.float32(1))))
    assert before[:5] == after[:5]
    assert before[5] != after[5]


@pytest.mark.parametrize("count", [50, 2000, 31000])
def test_an_order_without_structure_costs_its_entropy(count: int) -> None:
    places = np.random.default_rng(0).permutation(count)
    writer = SymbolWriter()
    code_permutation(writer, places, order_levels(count), count)
    assert 8 * len(writer.getvalue()) / count <= np.log2(count) + 1 + 200 / count


@pytest.mark.parametrize("row", [5, -1])
def test_an_order_that_is_no_permutation_is_corrupt(row: int) -> None:
    places = np.arange(50)
    places[7] = row
    with pytest.raises(CorruptBitstream, match="permutation"):
        code_permutation(SymbolWriter(), places, order_levels(50), 50)
