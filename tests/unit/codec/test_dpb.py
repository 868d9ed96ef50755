from __future__ import annotations

import hashlib
import struct
from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import FRAME_HASH_BYTES, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.state.planes import FrameState, Plane, output, sh_bands, sh_rest_of_bands
from dfcgs_codec.transform.companding import expand
from lab.small_clouds import make_cloud, same_cloud

UNITS = UnitExponents(-10, -12, -13, -14)


def make_state(degree: int = 2, *, permuted: bool = True) -> FrameState:
    state = state_of(make_cloud(20, degree), UNITS)
    order = Plane(np.random.default_rng(0).permutation(20)[:, None]) if permuted else None
    return FrameState(state.planes, order)


def with_plane(state: FrameState, attribute: Attribute, values: np.ndarray) -> FrameState:
    return replace(state, planes=state.planes | {attribute: Plane(values)})


@pytest.mark.parametrize("attribute", list(Attribute)[:7])
def test_the_hash_changes_with_every_value(attribute: Attribute) -> None:
    state = make_state()
    hashes = {state.hash()}
    values = state.planes[attribute].values
    for row in (0, 7, 19):
        for column in range(values.shape[1]):
            changed = values.copy()
            changed[row, column] += 1
            hashes.add(with_plane(state, attribute, changed).hash())
    assert len(hashes) == 1 + 3 * values.shape[1]


def test_the_hash_includes_the_output_order() -> None:
    state, plain = make_state(), make_state(permuted=False)
    swapped = state.order.values.copy()
    swapped[[0, 1]] = swapped[[1, 0]]
    assert len({state.hash(), plain.hash(), replace(state, order=Plane(swapped)).hash()}) == 3


def test_the_hash_includes_verbatim_floats() -> None:
    state = state_of(make_cloud(5, 1), UNITS)
    positions = state.verbatim.positions.copy()
    positions[3, 1] = np.nextafter(positions[3, 1], np.float32(9))
    other = replace(state, verbatim=replace(state.verbatim, positions=positions))
    assert len({state.hash(), other.hash(), replace(state, verbatim=None).hash()}) == 3


def test_negative_zero_is_another_verbatim_value() -> None:
    cloud = replace(make_cloud(1), positions=np.zeros((1, 3), np.float32))
    negative = replace(cloud, positions=np.full((1, 3), -0.0, np.float32))
    assert state_of(cloud, UNITS).hash() != state_of(negative, UNITS).hash()


def test_equal_states_have_equal_hashes() -> None:
    assert make_state().hash() == make_state().hash()
    assert len(make_state().hash()) == FRAME_HASH_BYTES


def blake(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=16).digest()


def test_the_hash_is_over_digests_of_little_endian_int32() -> None:
    planes = {
        Attribute.SCALE: Plane(np.array([[4, 5, 6]])),
        Attribute.POSITION: Plane(np.array([[1, -2, 3]])),
    }
    digests = [blake(struct.pack("<3i", *row)) for row in ((1, -2, 3), (4, 5, 6), (0,) * 3)]
    assert FrameState(planes).hash() == blake(digests[0] + digests[1])
    order = Plane(np.zeros((3, 1), np.int64))
    assert FrameState(planes, order).hash() == blake(b"".join(digests))


def test_an_attribute_does_not_stand_for_another() -> None:
    one, two = np.array([[1, 2, 3]]), np.array([[3, 2, 1]])
    ab = FrameState({Attribute.POSITION: Plane(one), Attribute.SCALE: Plane(two)})
    ba = FrameState({Attribute.POSITION: Plane(two), Attribute.SCALE: Plane(one)})
    assert ab.hash() != ba.hash()


def test_planes_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Plane(np.zeros((2, 3), np.int64)).values[0, 0] = 1


@pytest.mark.parametrize("degree", range(4))
def test_output_scales_by_powers_of_two(degree: int) -> None:
    state = make_state(degree, permuted=False)
    cloud = output(state, UNITS)
    planes = {attribute: plane.wide() for attribute, plane in state.planes.items()}
    assert np.array_equal(cloud.positions, (planes[Attribute.POSITION] * 2.0**-10).astype(np.float32))
    assert np.array_equal(cloud.scales, (planes[Attribute.SCALE] * 2.0**-12).astype(np.float32))
    assert np.array_equal(cloud.rotations, (planes[Attribute.ROTATION] * 2.0**-24).astype(np.float32))
    logits = expand(planes[Attribute.OPACITY][:, 0], -13) * 2.0**-13
    assert np.array_equal(cloud.opacities, logits.astype(np.float32))
    assert np.array_equal(cloud.sh_dc, (planes[Attribute.SH_DC] * 2.0**-14).astype(np.float32))
    assert cloud.sh_degree == degree


def test_output_is_close_to_what_went_in() -> None:
    cloud = make_cloud(50, 3)
    decoded = output(FrameState(state_of(cloud, UNITS).planes), UNITS)
    assert np.abs(decoded.sh_rest - cloud.sh_rest).max() <= 2.0**-15
    assert np.abs(decoded.positions - cloud.positions).max() <= 2.0**-11


def test_order_is_the_place_in_the_output() -> None:
    state = make_state()
    plain, ordered = output(replace(state, order=None), UNITS), output(state, UNITS)
    places = state.order.values[:, 0]
    assert np.array_equal(ordered.positions[places], plain.positions)
    assert np.array_equal(ordered.sh_rest[places], plain.sh_rest)


def test_verbatim_frames_come_out_as_they_are() -> None:
    cloud = make_cloud(8, 1)
    assert same_cloud(output(state_of(cloud, UNITS), UNITS), cloud)


@pytest.mark.parametrize("degree", range(4))
def test_sh_bands_are_inverse_and_coefficient_by_coefficient(degree: int) -> None:
    rest = make_cloud(6, degree).sh_rest
    bands = sh_bands(rest)
    assert [band.shape[1] for band in bands] == [9, 15, 21][:degree]
    assert np.array_equal(sh_rest_of_bands(bands, 6), rest)
    if degree:
        assert np.array_equal(bands[0][:, :4].T, [rest[:, 0, 0], rest[:, 1, 0], rest[:, 2, 0], rest[:, 0, 1]])
