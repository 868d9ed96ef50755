"""Prepared GoFs: decoded references, true targets, the codec's own spreading, and no evaluation scene."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

torch = pytest.importorskip("torch", reason="training needs torch, from the train extra")

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence  # noqa: E402
from dfcgs_codec.bitstream.constants import OutputOrder, Profile  # noqa: E402
from dfcgs_codec.errors import InputError  # noqa: E402
from lab.scenes.catalogue import group  # noqa: E402
from tests.training.paper_helpers import moving_clouds, small_gof  # noqa: E402
from training.paper.config import HELD_BACK  # noqa: E402
from training.paper.data import Data  # noqa: E402
from training.paper.gof import Gof, normalisation  # noqa: E402
from training.paper.prepare import Layout, choices, prepare_gof, training_scenes  # noqa: E402

EVALUATED = ("evaluation", "long", "captures")


@pytest.mark.parametrize("name", [scene.name for g in EVALUATED for scene in group(g)])
def test_evaluation_scenes_are_refused(name):
    with pytest.raises(InputError, match="only 'training' is trained on"):
        training_scenes([name])


def test_training_scenes_are_the_group():
    assert [s.name for s in training_scenes()] == [s.name for s in group("training")]
    assert set(HELD_BACK) < {s.name for s in training_scenes()}


def test_held_back_scenes_are_not_trained_on(tmp_path):
    small_gof().save(tmp_path / f"{HELD_BACK[0]}.0.npz")
    with pytest.raises(InputError, match="no prepared GoFs"):
        Data(tmp_path)
    small_gof().save(tmp_path / "sway.0.npz")
    assert Data(tmp_path).scenes == ["sway"]


def test_choices_stay_within_the_sequence():
    for choice in choices(16, 3):
        frames = [choice.first + i * choice.stride for i in range(5)]
        assert 0 <= min(frames) <= max(frames) < 16
    assert {choice.stride for choice in choices(6, 0)} == {1, -1}


def test_the_reference_is_what_the_codec_decodes(tmp_path):
    clouds, gof = moving_clouds(), small_gof()
    path = tmp_path / "one.dgs"
    encode_sequence(
        clouds[:1], path, EncoderOptions(qp=22.0, gof_size=1, order=OutputOrder.FREE, profile=Profile.PAPER)
    )
    decoded = next(iter(decode_sequence(path))).cloud()
    positions = np.ldexp(gof.positions[0].astype(np.float64), int(gof.units[0])).astype(np.float32)
    assert np.array_equal(decoded.positions, positions)
    # axes of a sequence's first frame go by any names; shapes in space are the same
    scales = np.exp(np.ldexp(gof.scales.astype(np.float64), int(gof.units[1])))
    expected = _covariances(np.ldexp(gof.rotations[0].astype(np.float64), -24), scales)
    found = _covariances(decoded.rotations.astype(np.float64), np.exp(decoded.scales.astype(np.float64)))
    assert np.allclose(found, expected, rtol=1e-4, atol=1e-9)


def _covariances(rotations, scales):
    axes = Rotation.from_quat(rotations, scalar_first=True).as_matrix() * scales[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def test_targets_are_the_input_in_the_order_of_the_reference():
    clouds, gof = moving_clouds(), small_gof()
    unit = 2.0 ** int(gof.units[0])
    went = (gof.positions[3] - gof.positions[1]) * unit
    expected = clouds[3].positions - clouds[1].positions
    assert np.allclose(np.sort(went, axis=0), np.sort(expected, axis=0), atol=2 * unit)
    assert len(expected) == gof.num_gaussians
    # frame 0 was quantised, and nothing else
    assert np.abs(gof.positions[0] - gof.positions[1]).max() * unit < 0.1


def test_control_points_are_their_own_nearest_and_weights_sum_to_one():
    gof = small_gof()
    assert len(gof.control) == 700 // 70
    assert np.array_equal(gof.neighbours[:, 0], gof.control)
    assert (gof.weights.sum(axis=1) == 1 << 16).all()
    assert gof.neighbours.shape == (10, 30)


def test_every_gaussian_may_have_its_own_motion():
    gof = prepare_gof(moving_clouds(90), 22.0, "+y", 0, Layout(control_spacing=1, num_neighbours=1))
    assert sorted(gof.control.tolist()) == list(range(90))
    assert np.array_equal(gof.neighbours[:, 0], gof.control)
    assert (gof.weights == 1 << 16).all()


def test_normalisation_puts_the_bulk_into_the_unit_cube():
    rng = np.random.default_rng(0)
    positions = rng.normal(0, 1000, (5000, 3)).astype(np.int64) + 12345
    positions[:20] *= 1 << 14
    centre, extent_log2 = normalisation(positions)
    inside = (np.abs(positions - centre) <= 1 << extent_log2).all(axis=1)
    assert 0.7 < inside.mean() < 1
    assert extent_log2 == 11


def test_a_gof_comes_back_from_its_file(tmp_path):
    gof = small_gof()
    gof.save(tmp_path / "a.npz")
    back = Gof.load(tmp_path / "a.npz")
    assert np.array_equal(back.rotations, gof.rotations)
    assert np.array_equal(back.weights, gof.weights)
    assert back.log2_unit == gof.log2_unit
