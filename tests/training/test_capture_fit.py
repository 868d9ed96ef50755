"""Captures in miniature: densification, frame 0 of a box with a checkpoint, a sequence, what is kept."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.captures import keep
from lab.captures.captures import Capture
from lab.captures.mesh import Actor, joined
from lab.captures.rigs import evaluation_cameras, fitting_cameras
from lab.render import Camera, View
from lab.scenes import fitted_sequence
from tests.lab.captures.sheets import BARE, FLOOR, RIGS, SIZE, picture, sheet, upright
from training.captures import fit, optimise
from training.captures.densify import FAINT, RESET, Pull, densify, image_gradient, reset_opacities
from training.captures.start import points_in_view, random_cloud
from training.fitting.adam import Adam
from training.fitting.loss import loss_gradient
from training.fitting.store import shortened


def cloud_of(scales: list[float], logits: list[float]) -> GaussianCloud:
    n = len(scales)
    arrays = (
        np.arange(3.0 * n).reshape(n, 3),
        np.tile([2.0, 0.0, 0.0, 0.0], (n, 1)),
        np.tile(np.log(scales)[:, None], (1, 3)),
        np.array(logits),
        np.zeros((n, 3)),
        np.zeros((n, 3, 0)),
    )
    return GaussianCloud(*(np.ascontiguousarray(array, dtype=np.float32) for array in arrays))


def pulled(*means: float) -> Pull:
    return Pull(np.array(means, np.float32), np.ones(len(means), np.float32))


class TestDensify:
    def test_small_ones_are_cloned_large_ones_split_faint_ones_go(self) -> None:
        adam = optimise.State.of(cloud_of([0.001, 0.5, 0.001, 0.5], [0.0, 0.0, -9.0, 0.0])).adam
        densify(adam, pulled(1.0, 1.0, 1.0, 0.0), 1.0, 100, np.random.default_rng(0))
        values = adam.values
        # the first and the last are kept, the first's clone follows, then the halves of the second
        assert values["positions"][:3].tolist() == [[0, 1, 2], [9, 10, 11], [0, 1, 2]]
        assert values["scales"][:, 0] == pytest.approx(np.log([0.001, 0.5, 0.001, 0.5 / 1.6, 0.5 / 1.6]))
        halves = values["positions"][3:] - np.array([3, 4, 5])
        assert (np.abs(halves) > 0.0).all()
        assert np.abs(halves).max() < 2.5

    def test_never_more_than_asked_for_and_the_most_pulled_first(self) -> None:
        adam = optimise.State.of(cloud_of([0.001] * 4, [0.0] * 4)).adam
        densify(adam, pulled(1.0, 3.0, 2.0, 0.5), 1.0, 6, np.random.default_rng(0))
        assert adam.values["positions"][4:, 0].tolist() == [3, 6]

    def test_new_ones_have_no_past_and_old_ones_keep_theirs(self) -> None:
        adam = optimise.State.of(cloud_of([0.001] * 2, [0.0] * 2)).adam
        gradients = {name: np.ones_like(array) for name, array in adam.values.items()}
        adam.step(gradients, dict.fromkeys(gradients, 0.0))
        densify(adam, pulled(0.0, 1.0), 1.0, 100, np.random.default_rng(0))
        mean = adam.arrays()["mean_opacities"]
        assert mean == pytest.approx([0.1, 0.1, 0.0])
        reset_opacities(adam)
        assert (adam.arrays()["mean_opacities"] == 0.0).all()
        assert 1.0 / (1.0 + np.exp(-adam.values["opacities"])) == pytest.approx(RESET)
        assert RESET > FAINT

    def test_image_gradient_is_that_by_pixels_in_half_images(self) -> None:
        camera = fitting_cameras(RIGS["forward"], SIZE)[3]
        point = np.array([[0.3, 1.2, -0.4]])
        by_pixel = np.array([0.7, -0.2])
        by_point = np.zeros((1, 3), np.float32)
        for axis in range(3):
            step = 1e-4 * np.eye(3)[axis]
            by_point[0, axis] = (pixel(point + step, camera) - pixel(point - step, camera)) @ by_pixel / 2e-4
        expected = np.hypot(*(by_pixel * (16, 12)))
        assert image_gradient(point, by_point, camera)[0] == pytest.approx(expected, rel=1e-3)


def pixel(point: np.ndarray, camera: Camera) -> np.ndarray:
    seen = camera.world_to_camera[:3, :3] @ point[0] + camera.world_to_camera[:3, 3]
    return np.array([camera.fx * seen[0], camera.fy * seen[1]]) / seen[2]


TINY = Capture("captures", "-", Actor("-", "-"), RIGS["forward"], start=150, most=200, first_steps=120)


@pytest.fixture(scope="module")
def views() -> list[View]:
    mesh = joined(sheet(FLOOR), upright(1.5, -1.0))
    cameras = fitting_cameras(TINY.rig, SIZE)[::4]
    return [View(camera, picture(mesh, BARE, camera), (0.0, 0.0, 0.0)) for camera in cameras]


class TestFirstFrame:
    def test_it_begins_at_random_in_what_the_cameras_see(self, views: list[View]) -> None:
        cameras = [view.camera for view in views]
        points = points_in_view(cameras, 100, (1.0, 9.0), np.random.default_rng(0))
        inside = np.zeros(100, bool)
        for camera in cameras:
            seen = points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
            u, v = camera.fx * seen[:, 0] / seen[:, 2], camera.fy * seen[:, 1] / seen[:, 2]
            inside |= (
                (np.abs(u) <= 16.001) & (np.abs(v) <= 12.001) & (seen[:, 2] > 0.99) & (seen[:, 2] < 9.01)
            )
        assert inside.all()
        assert random_cloud(TINY, cameras).num_gaussians == 150

    def test_the_loss_falls_and_a_run_goes_on_where_it_stopped(
        self, views: list[View], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(optimise, "DENSIFY_FROM", 10)
        monkeypatch.setattr(optimise, "DENSIFY_EVERY", 20)
        monkeypatch.setattr(optimise, "RESET_EVERY", 30)
        monkeypatch.setattr(optimise, "SAVE_EVERY", 50)
        start = random_cloud(TINY, [view.camera for view in views])
        whole = optimise.optimise(start, TINY, views, tmp_path / "a")
        assert mean_loss(whole, views) < 0.7 * mean_loss(start, views)
        assert whole.num_gaussians != start.num_gaussians

        def interrupted(step: int, loss: float, count: int) -> None:
            if step == 70:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            optimise.optimise(start, TINY, views, tmp_path / "b", interrupted)
        steps: list[int] = []
        parts = optimise.optimise(start, TINY, views, tmp_path / "b", lambda step, *_: steps.append(step))
        assert steps[0] == 50
        for field in dataclasses.fields(GaussianCloud):
            assert np.array_equal(getattr(whole, field.name), getattr(parts, field.name)), field.name

    def test_a_checkpoint_of_other_settings_is_refused(self, views: list[View], tmp_path: Path) -> None:
        optimise.save(tmp_path / "a", optimise.State.of(cloud_of([0.1], [0.0])), TINY)
        with pytest.raises(InputError, match="other settings"):
            optimise.load(tmp_path / "a", dataclasses.replace(TINY, seed=1))


def mean_loss(cloud: GaussianCloud, views: list[View]) -> float:
    return float(np.mean([loss_gradient(cloud, view)[0] for view in views]))


class TestSequence:
    @pytest.fixture
    def few(self, monkeypatch: pytest.MonkeyPatch) -> Capture:
        """A capture of ten steps; a sheet moves in it, seen by few cameras of few pixels."""
        monkeypatch.setattr(fit, "fitting_cameras", lambda rig: fitting_cameras(rig, SIZE)[::4])
        monkeypatch.setattr(fit, "evaluation_cameras", lambda rig: evaluation_cameras(rig, SIZE)[:2])
        monkeypatch.setattr(fit, "true_views", moving_views)
        monkeypatch.setattr(keep, "EVERY", 2)
        return dataclasses.replace(TINY, first_steps=10, later_steps=3)

    def test_it_is_stored_with_cameras_images_and_report(self, few: Capture, tmp_path: Path) -> None:
        rows = list(fit.fit_capture("x", few, 3, tmp_path))
        assert [row["frame"] for row in rows] == [0, 1, 2]
        assert keep.read_report(tmp_path / "x") == rows
        assert len(json.loads((tmp_path / "x" / "cameras.json").read_text())) == 5
        kept = keep.read_images(tmp_path / "x", 1, SIZE[1])
        expected = [views[6] for views in moving_views(few, cameras_of(few), 3)][::2]
        assert np.array_equal(kept, [keep.to_bytes(view.image) for view in expected])
        assert sorted(path.name for path in tmp_path.iterdir()) == ["x", "x.zip"]

    def test_frames_that_are_there_are_kept(self, few: Capture, tmp_path: Path) -> None:
        list(fit.fit_capture("x", few, 1, tmp_path))
        first = next(iter(fitted_sequence(tmp_path / "x.zip")))
        rows = list(fit.fit_capture("x", few, 2, tmp_path))
        assert rows[0]["seconds"] is not None
        frames = list(fitted_sequence(tmp_path / "x.zip"))
        assert len(frames) == 2
        assert np.array_equal(frames[0].positions, first.positions)
        with pytest.raises(InputError, match="other settings"):
            list(fit.fit_capture("x", dataclasses.replace(few, seed=5), 2, tmp_path))


def cameras_of(capture: Capture) -> list[Camera]:
    return [*fitting_cameras(capture.rig, SIZE)[::4], *evaluation_cameras(capture.rig, SIZE)[:2]]


def moving_views(_: Capture, cameras: list[Camera], num_frames: int) -> Iterator[list[View]]:
    for index in range(num_frames):
        mesh = joined(sheet(FLOOR), upright(1.5, -1.0 + 0.2 * index))
        yield [View(camera, picture(mesh, BARE, camera), (0.0, 0.0, 0.0)) for camera in cameras]


class TestKept:
    def test_a_report_comes_back(self, tmp_path: Path) -> None:
        assert keep.read_report(tmp_path) == []
        rows = [{"frame": 0, "seconds": 1.5}, {"frame": 1, "seconds": None}]
        keep.write_report(tmp_path, rows)
        assert keep.read_report(tmp_path) == rows

    def test_shortened_values_are_as_good_as_equal(self) -> None:
        cloud = cloud_of([0.001, 0.5, 3.0], [-9.0, 0.1, 7.0])
        for field in dataclasses.fields(cloud):
            short, whole = (getattr(c, field.name) for c in (shortened(cloud), cloud))
            assert short == pytest.approx(whole, rel=2.0**-16, abs=0.0)
            assert not (short.view(np.uint32) & 0xFF).any()

    def test_images_come_back_as_they_were(self, tmp_path: Path) -> None:
        rng = np.random.default_rng(0)
        first = rng.integers(0, 256, (24, 32, 3)).astype(np.uint8)
        changed = first.copy()
        changed[5:9, 5:9] = 7
        images = [first, changed, changed, first]
        keep.write_images(tmp_path, 3, images)
        assert np.array_equal(keep.read_images(tmp_path, 3, 24), images)

    def test_adam_as_it_was(self) -> None:
        adam = Adam({"x": np.ones(3, np.float32)})
        adam.step({"x": np.ones(3, np.float32)}, {"x": 0.1})
        other = Adam.from_arrays(adam.arrays())
        for each in (adam, other):
            each.step({"x": np.ones(3, np.float32)}, {"x": 0.1})
        assert np.array_equal(adam.values["x"], other.values["x"])
