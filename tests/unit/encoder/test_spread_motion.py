"""The paper's rule as an encoder's option: it decodes, with births and deaths, and is what it says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import Compensation, OutputOrder
from dfcgs_codec.encoder.options import MotionMode
from tests.helpers import make_cloud, still, succeeding, travelling, waving

PAPER = EncoderOptions(compensation=Compensation.SPREAD, control_spacing=20, qp=20, order=OutputOrder.INPUT)


def small(count: int) -> GaussianCloud:
    cloud = make_cloud(count, 0)
    return replace(cloud, scales=cloud.scales - 3)


def code(
    frames: list[GaussianCloud], folder: Path, options: EncoderOptions
) -> tuple[list[GaussianCloud], list[int]]:
    """Decoded frames, hashes checked, and control points by frame."""
    path = folder / "sequence.dgs"
    encode_sequence(frames, path, options, force=True)
    decoded = [frame.cloud() for frame in decode_sequence(path)]
    return decoded, [frame.control_points for frame in probe(path).frames]


def apart(a: GaussianCloud, b: GaussianCloud) -> float:
    return float(np.abs(a.positions - b.positions).max())


def test_a_residual_makes_up_for_what_the_rule_misses(tmp_path: Path) -> None:
    cloud = small(1000)
    frames = [waving(cloud, 0.05 * index) for index in range(4)]
    first = apart(frames[0], code(frames[:1], tmp_path, PAPER)[0][0])
    decoded, points = code(frames, tmp_path, replace(PAPER, motion=MotionMode.ON, visibility=False))
    assert points == [0, 50, 50, 50]
    assert max(apart(*pair) for pair in zip(frames, decoded, strict=True)) < 1.3 * first


def test_every_control_point_gives_its_own_displacement(tmp_path: Path) -> None:
    """A Gaussian that two control points reach moves twice its share: the rule is not a mean."""
    frames = travelling(small(400), 2, speed=0.5)
    decoded, _ = code(frames, tmp_path, replace(PAPER, motion=MotionMode.ONLY))
    went = decoded[1].positions - decoded[0].positions
    speed = frames[1].positions[0] - frames[0].positions[0]
    # what all control points give is what they move, all together
    assert went.sum(axis=0) == pytest.approx(20 * speed, rel=0.01, abs=0.1)
    assert np.abs(went).max() < np.abs(speed).max()


@pytest.mark.parametrize("mode", [MotionMode.ON, MotionMode.ONLY])
def test_births_and_deaths(mode: MotionMode, tmp_path: Path) -> None:
    frames = succeeding(small(400), 5)
    decoded, points = code(frames, tmp_path, replace(PAPER, motion=mode))
    assert [cloud.num_gaussians for cloud in decoded] == [cloud.num_gaussians for cloud in frames]
    assert max(points) == 20


def test_it_is_absent_where_it_does_not_pay(tmp_path: Path) -> None:
    assert code(still(small(300), 3), tmp_path, PAPER)[1] == [0, 0, 0]


def test_a_single_gaussian(tmp_path: Path) -> None:
    frames = travelling(small(1), 3)
    decoded, _ = code(frames, tmp_path, replace(PAPER, motion=MotionMode.ONLY))
    assert apart(frames[2], decoded[2]) < 0.05
