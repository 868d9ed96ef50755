"""Motion is found, pays, and is absent where it does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.encoder.motion.motion_judge import lasting_bits, residual_bits
from dfcgs_codec.encoder.plan.tuning import MotionMode
from lab.options import encoder_options
from lab.small_clouds import all_changing, make_cloud, real_cloud, still, travelling, waving
from tests.helpers import QUICK

OFF = encoder_options(QUICK, motion=MotionMode.OFF)


def small(count: int, seed: int = 0) -> GaussianCloud:
    """Gaussians so small that every position counts."""
    cloud = make_cloud(count, 0, seed)
    return replace(cloud, scales=cloud.scales - 3)


def sizes(frames: list[GaussianCloud], folder: Path, options: EncoderOptions) -> list[dict[str, int]]:
    """Bytes of each P-frame by what they are spent on, and in all."""
    path = folder / "sequence.dgs"
    encode_sequence(frames, path, options, force=True)
    assert len(list(decode_sequence(path))) == len(frames)
    return [frame.attribute_bytes | {"all": frame.num_bytes} for frame in probe(path).frames[1:]]


def test_a_turning_part_costs_little(tmp_path: Path) -> None:
    cloud = small(3000)
    frames = [waving(cloud, 0.05 * index) for index in range(5)]
    with_motion = sizes(frames, tmp_path, encoder_options(QUICK, control_spacing=40))
    without = sizes(frames, tmp_path, OFF)
    assert all("MOTION" in frame for frame in with_motion)
    assert sum(f["all"] for f in with_motion) < 0.5 * sum(f["all"] for f in without)
    # who moves with whom is learnt
    assert with_motion[-1]["all"] < 0.5 * with_motion[0]["all"]


def test_what_stands_still_beside_motion_keeps_every_bit(tmp_path: Path) -> None:
    cloud = small(2000)
    frames = [waving(cloud, 0.05 * index) for index in range(4)]
    path = tmp_path / "sequence.dgs"
    encode_sequence(frames, path, encoder_options(qp=28, control_spacing=40))
    decoded = [frame.state.planes for frame in decode_sequence(path)]
    changed = np.zeros(2000, bool)
    for planes in decoded[1:]:
        for attribute, plane in planes.items():
            changed |= (plane.values != decoded[0][attribute].values).any(axis=1)
    moving = np.count_nonzero(cloud.positions[:, 0] > 0.2)
    assert np.count_nonzero(changed) <= moving


def test_a_scene_that_travels_takes_little(tmp_path: Path) -> None:
    found = sizes(travelling(small(2000), 3), tmp_path, QUICK)
    assert max(frame["all"] for frame in found) < 200


@pytest.mark.parametrize("frames", [still(small(300), 3), all_changing(make_cloud(300, 1), 3)])
def test_motion_that_does_not_pay_is_absent(frames: list[GaussianCloud], tmp_path: Path) -> None:
    found = sizes(frames, tmp_path, QUICK)
    without = sizes(frames, tmp_path, OFF)
    assert sum(f["all"] for f in found) <= sum(f["all"] for f in without)


def test_motion_can_be_left_alone(tmp_path: Path) -> None:
    alone = sizes(all_changing(make_cloud(300), 3), tmp_path, encoder_options(QUICK, motion=MotionMode.ONLY))
    assert all(set(frame) == {"MOTION", "all"} for frame in alone)


def test_outliers_and_coincident_gaussians(tmp_path: Path) -> None:
    cloud = real_cloud(900)
    positions = cloud.positions.copy()
    positions[:5] *= 1000
    positions[100:200] = positions[100]
    cloud = replace(cloud, positions=positions)
    found = sizes(
        [waving(cloud, 0.02 * i) for i in range(3)], tmp_path, encoder_options(QUICK, control_spacing=15)
    )
    assert len(found) == 2


def test_errors_that_stay_cost_their_square_up_to_a_limit() -> None:
    assert lasting_bits(np.array([[0.0, 0.0, 0.0]])) == 0
    one = lasting_bits(np.array([[1.0, 0.0, 0.0]]))
    assert lasting_bits(np.array([[3.0, -4.0, 0.0]])) == pytest.approx(25 * one)
    assert lasting_bits(np.array([[1e9, 0, 0]])) == lasting_bits(np.array([[1e3, 0, 0]]))


def test_residual_bits_rise_with_errors() -> None:
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(500, 3))
    bits = [residual_bits(errors * size) for size in (0.1, 0.5, 1, 4, 100)]
    assert bits == sorted(bits)
    assert residual_bits(0 * errors) < 1e-3
    # errors that are not coded cost their square
    assert bits[0] == pytest.approx(6.0 * (0.01 * errors**2).sum(), rel=0.01)
