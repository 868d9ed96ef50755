from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import Bound, EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.plan.prequantised_input import keep_exactly, lattice_log2, lattices
from dfcgs_codec.encoder.plan.quantiser_steps import plan_quantisation
from dfcgs_codec.sequence import MemorySource
from lab.options import encoder_options
from lab.small_clouds import drifting, on_lattices, real_cloud


def found_in(
    frames: list[GaussianCloud], qp: float = 18, bounds: tuple[Bound, ...] = ()
) -> frozenset[Attribute]:
    quantisation = plan_quantisation(qp, bounds, frames[0])
    return keep_exactly(quantisation, MemorySource(frames), lattices(frames[0]), frames[0].sh_degree).exact


@pytest.mark.parametrize("exponent", [0, 1, 4, 12])
def test_the_largest_step_is_found(exponent: int) -> None:
    values = np.random.default_rng(exponent).integers(-40, 40, (500, 3)).astype(np.float32)
    assert lattice_log2(np.ldexp(values, -exponent)) == -exponent


def test_real_numbers_zeros_and_signs_are_no_lattice() -> None:
    rng = np.random.default_rng(0)
    assert lattice_log2(rng.normal(size=2000).astype(np.float32)) is None
    assert lattice_log2(np.zeros(2000, np.float32)) is None
    assert lattice_log2(rng.integers(-1, 2, 2000).astype(np.float32)) is None
    few = np.zeros(2000, np.float32)
    few[:10] = 0.5 * np.arange(10)
    assert lattice_log2(few) is None


def test_a_few_values_may_lie_between() -> None:
    values = np.random.default_rng(1).integers(-9, 9, 5000).astype(np.float32) / 8
    values[7] = 127 / 128
    assert lattice_log2(values) == -3
    values[::50] = 0.3
    assert lattice_log2(values) is None


def test_what_is_quantised_is_found_and_what_is_not_is_not() -> None:
    cloud = real_cloud(2000)
    assert lattices(cloud) == {}
    assert lattices(on_lattices(cloud)) == {
        Attribute.POSITION: -12, Attribute.SCALE: -4, Attribute.SH_1: -4, Attribute.SH_2: -4,
    }  # fmt: skip
    exact = found_in([on_lattices(cloud)])
    assert {Attribute.SCALE, Attribute.SH_1, Attribute.SH_2} <= exact
    assert found_in([cloud]) == frozenset()


def test_what_would_cost_more_is_coded_anew() -> None:
    assert found_in([on_lattices(real_cloud(2000))], qp=40) == frozenset()


def test_bounded_attributes_keep_their_bounds() -> None:
    frames = [on_lattices(real_cloud(2000))]
    assert Attribute.SCALE not in found_in(frames, bounds=(Bound("scale", 0.001),))
    assert found_in(frames, bounds=(Bound("sh", 0.001),)) == frozenset()


def test_later_frames_must_be_quantised_too() -> None:
    cloud = real_cloud(2000)
    assert found_in([on_lattices(cloud)] * 3)
    assert not found_in([on_lattices(cloud), on_lattices(cloud), cloud])
    assert not found_in([on_lattices(cloud), cloud, on_lattices(cloud)])


@pytest.mark.parametrize("moves", [False, True])
def test_every_value_comes_back(tmp_path: Path, moves: bool) -> None:
    frames = [
        on_lattices(frame) for frame in (drifting(real_cloud(1500), 3) if moves else [real_cloud(1500)])
    ]
    path = tmp_path / "exact.dgs"
    report = encode_sequence(frames, path, EncoderOptions(qp=18))
    assert any("has quantised" in note for note in report.notes)
    for decoded, frame in zip(decode_sequence(path), frames, strict=True):
        cloud = decoded.cloud()
        found = cloud.take(np.lexsort(cloud.sh_rest[:, :, :3].reshape(len(cloud.sh_rest), -1).T))
        wanted = frame.take(np.lexsort(frame.sh_rest[:, :, :3].reshape(len(frame.sh_rest), -1).T))
        assert np.array_equal(found.sh_rest[:, :, :3], wanted.sh_rest[:, :, :3])
        assert np.array_equal(np.sort(found.scales.ravel()), np.sort(wanted.scales.ravel()))


def test_exact_is_smaller_and_better(tmp_path: Path) -> None:
    frames = [on_lattices(real_cloud(6000))]
    sizes = {}
    for exact in (True, False):
        path = tmp_path / f"{exact}.dgs"
        report = encode_sequence(frames, path, encoder_options(qp=14, exact=exact))
        sizes[exact] = path.stat().st_size, report.errors["sh"].mean, report.errors["scale"].mean
    assert all(np.array(sizes[True]) < np.array(sizes[False]))
    assert sizes[True][1] == 0.0
