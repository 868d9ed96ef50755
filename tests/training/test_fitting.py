"""Fitting in miniature: 200 Gaussians, a few views of 32 pixels, one boulder that moves."""

from __future__ import annotations

import dataclasses
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import fitted_sequence, rotations
from training.fitting import fit, report
from training.fitting.activity import activity
from training.fitting.adam import Adam
from training.fitting.capture import painted, psnr, take_views, training_cameras
from training.fitting.deform import Deformation, turn_gradient, turned
from training.fitting.first import fit_first, rough_cloud
from training.fitting.loss import loss_gradient
from training.fitting.sequences import FITTED, FittedSequence, TrueFrame
from training.fitting.stage import stage_cloud
from training.fitting.track import moving_gaussians, track

SIZE = (32, 32)
CAMERAS = list(islice(training_cameras(SIZE), 0, None, 3))
SHIFT = np.array([0.0, 0.3, 0.0], np.float32)
TINY = FittedSequence("-", "-", 30.0, character=60, stage=140)


def truth(moved: bool) -> TrueFrame:
    """A stage; the boulders at one end count as the character, and rise."""
    cloud = stage_cloud(3000, 1, seed=1)
    is_character = (cloud.positions[:, 1] > 0.0) & (cloud.positions[:, 0] > 1.0)
    positions = cloud.positions + SHIFT * is_character[:, None] * moved
    return TrueFrame(dataclasses.replace(cloud, positions=positions.astype(np.float32)), is_character)


@pytest.fixture(scope="module")
def views() -> tuple[list, list]:
    return tuple(take_views(truth(moved), CAMERAS) for moved in (False, True))


@pytest.fixture(scope="module")
def first(views: tuple[list, list]) -> GaussianCloud:
    return fit_first(rough_cloud(truth(False), TINY), views[0], 150, seed=0)


def mean_loss(cloud: GaussianCloud, views: list) -> float:
    return float(np.mean([loss_gradient(cloud, view)[0] for view in views]))


class TestFirst:
    def test_the_loss_falls(self, views: tuple[list, list], first: GaussianCloud) -> None:
        start = rough_cloud(truth(False), TINY)
        assert start.num_gaussians == first.num_gaussians == 200
        assert mean_loss(first, views[0]) < 0.7 * mean_loss(start, views[0])
        assert psnr(first, views[0]) > psnr(start, views[0]) + 2.0

    def test_deterministic(self, views: tuple[list, list]) -> None:
        a, b = (fit_first(rough_cloud(truth(False), TINY), views[0], 5, seed=0) for _ in range(2))
        assert all(
            np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(GaussianCloud)
        )


class TestTrack:
    def test_follows_what_moves_and_leaves_the_rest(
        self, views: tuple[list, list], first: GaussianCloud
    ) -> None:
        before, after = views
        rows = moving_gaussians(first, after, before).rows
        assert 0 < len(rows) < 150
        moved = track(first, None, (after, before), 80, (0, 1))
        # what the motion adds to the loss of the first frame shrinks
        floor = mean_loss(first, before)
        assert mean_loss(moved, after) - floor < 0.6 * (mean_loss(first, after) - floor)
        for name in ("positions", "rotations"):
            old, new = getattr(first, name), getattr(moved, name)
            assert np.array_equal(np.delete(old, rows, 0), np.delete(new, rows, 0))
            assert (old[rows] != new[rows]).any(axis=1).all()
        for name in ("scales", "opacities", "sh_dc", "sh_rest"):
            assert getattr(first, name) is getattr(moved, name)
        assert np.median((moved.positions - first.positions)[rows, 1]) > 0.05

    def test_nothing_moves_where_nothing_changes(
        self, views: tuple[list, list], first: GaussianCloud
    ) -> None:
        assert not activity(first, views[0], views[0]).any()
        assert track(first, None, (views[0], views[0]), 3, (0, 1)) is first


class TestFile:
    @pytest.fixture(autouse=True)
    def small(self, monkeypatch: pytest.MonkeyPatch) -> None:
        frames = [truth(False), truth(True), truth(False)]
        monkeypatch.setattr(fit, "true_frames", lambda sequence, count: iter(frames[:count]))
        monkeypatch.setattr(fit, "training_cameras", lambda: CAMERAS)
        monkeypatch.setattr(report, "held_out_cameras", lambda: CAMERAS[:2])

    def test_continued_is_the_same_as_at_once(self, tmp_path: Path) -> None:
        few = dataclasses.replace(TINY, first_steps=5, later_steps=5)
        for name, counts in (("once", [3]), ("continued", [1, 2, 2, 3])):
            for count in counts:
                rows = list(fit.fit_sequence(few, count, tmp_path / name, [1.5]))
        assert (tmp_path / "once").read_bytes() == (tmp_path / "continued").read_bytes()
        assert [row["seconds"] for row in rows[:2]] == [1.5, None]
        assert [f.num_gaussians for f in fitted_sequence(tmp_path / "once")] == [200] * 3

    def test_other_settings_are_refused(self, tmp_path: Path) -> None:
        few = dataclasses.replace(TINY, first_steps=1)
        list(fit.fit_sequence(few, 1, tmp_path / "x.zip", []))
        with pytest.raises(InputError, match="other settings"):
            list(fit.fit_sequence(dataclasses.replace(few, seed=1), 1, tmp_path / "x.zip", []))


class TestParts:
    def test_activity_is_one_where_every_pixel_changes_by_one(self, first: GaussianCloud) -> None:
        black, white = (
            [dataclasses.replace(v, image=np.full((*SIZE, 3), level, np.float32)) for v in views_of(first)]
            for level in (0, 1)
        )
        found = activity(first, white, black)
        assert found.max() == pytest.approx(1.0, abs=1e-5)

    def test_paint_is_seen(self, first: GaussianCloud) -> None:
        colours = np.random.default_rng(0).random((200, 3)).astype(np.float32)
        cloud = painted(first, colours)
        assert 0.5 + 0.28209479 * cloud.sh_dc == pytest.approx(colours, abs=1e-6)

    def test_deformation_gradient_is_the_transpose(self) -> None:
        rng = np.random.default_rng(0)
        deformation = Deformation(rng.normal(size=(300, 3)).astype(np.float32), rng)
        for array in deformation.values.values():
            array[:] = rng.normal(size=array.shape)
        by_displacement, by_turn = rng.normal(size=(2, 300, 3))
        displacement, turn = deformation.motion()
        gradients = deformation.gradients(by_displacement, by_turn)
        # linear: <g, A v> = <A' g, v>
        left = (by_displacement * displacement).sum() + (by_turn * turn).sum()
        right = sum((gradients[name] * array).sum() for name, array in deformation.values.items())
        assert left == pytest.approx(right, rel=1e-4)

    def test_equal_twists_of_all_nodes_are_a_rigid_motion(self) -> None:
        rng = np.random.default_rng(0)
        points = rng.normal(size=(300, 3)).astype(np.float32)
        deformation = Deformation(points, rng)
        turn, centre = np.array([0.0, 0.1, 0.2]), points.mean(axis=0, dtype=np.float64)
        deformation.values["node_turn"][:] = turn
        deformation.values["node_shift"][:] = np.cross(turn, deformation.nodes)
        displacement, turns = deformation.motion()
        assert displacement == pytest.approx(np.cross(turn, points - centre), abs=1e-6)
        assert turns == pytest.approx(np.broadcast_to(turn, (300, 3)), abs=1e-6)

    def test_turn_gradient_against_differences(self) -> None:
        rng = np.random.default_rng(0)
        quaternions, gradient = rng.normal(size=(2, 50, 4))
        found = turn_gradient(quaternions, gradient)
        for axis, unit in enumerate(np.eye(3)):
            change = rotations.multiply(rotations.from_vectors(1e-4 * unit), quaternions) - quaternions
            assert found[:, axis] == pytest.approx((gradient * change).sum(axis=1) / 1e-4, abs=1e-3)

    def test_turned_keeps_the_length(self) -> None:
        rng = np.random.default_rng(0)
        quaternions = rng.normal(size=(50, 4)).astype(np.float32)
        found = turned(quaternions, rng.normal(size=(50, 3)))
        assert np.linalg.norm(found, axis=1) == pytest.approx(np.linalg.norm(quaternions, axis=1), rel=1e-5)

    def test_first_step_of_adam_is_the_rate(self) -> None:
        values = {"x": np.zeros(3, np.float32)}
        Adam(values).step({"x": np.array([1e-6, -3.0, 0.0], np.float32)}, {"x": 0.5})
        assert values["x"] == pytest.approx([-0.5, 0.5, 0.0], abs=1e-5)

    def test_training_and_evaluation_share_nothing(self) -> None:
        sequences = list(FITTED.values())
        assert len({s.asset for s in sequences}) == len({s.clip for s in sequences}) == len(sequences)


def views_of(cloud: GaussianCloud) -> list:
    return take_views(TrueFrame(cloud, np.zeros(cloud.num_gaussians, np.bool_)), CAMERAS[:3])
