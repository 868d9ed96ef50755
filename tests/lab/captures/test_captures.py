"""The captures that are part of the repository, against the true images kept beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from lab.assets import find_asset
from lab.captures import keep
from lab.captures.captures import CAPTURES
from lab.captures.rigs import evaluation_cameras, fitting_cameras
from lab.quality import image
from lab.scenes import fitted_sequence
from lab.scenes.catalogue import Scene, group
from lab.views import cameras

#: decibel to the truth between the cameras of a rig; rings around a room see most of it from few places
LEAST_PSNR = {"forward": 27.0, "inside": 19.0}


def beside(scene: Scene) -> Path:
    return find_asset(scene.asset).with_suffix("")


@pytest.mark.parametrize("scene", group("captures"), ids=lambda scene: scene.name)
class TestCapture:
    def test_it_is_seen_from_between_its_cameras(self, scene: Scene) -> None:
        expected = evaluation_cameras(CAPTURES[beside(scene).name].rig)
        for view, camera in zip(cameras(scene.name), expected, strict=True):
            assert view.world_to_camera == pytest.approx(camera.world_to_camera, abs=1e-5)
            assert (view.fx, view.width, view.height) == (camera.fx, camera.width, camera.height)

    def test_its_cameras_lie_beside_it(self, scene: Scene, tmp_path: Path) -> None:
        keep.write_cameras(tmp_path, fitting_cameras(CAPTURES[beside(scene).name].rig))
        found = keep.read_cameras(beside(scene))
        expected = keep.read_cameras(tmp_path)
        for one, other in zip(found, expected, strict=True):
            assert one["position"] == pytest.approx(other["position"])
            assert np.array(one["rotation"]) == pytest.approx(np.array(other["rotation"]))

    def test_frames_are_like_the_true_images(self, scene: Scene) -> None:
        frames = list(fitted_sequence(find_asset(scene.asset)))[:: keep.EVERY]
        kind = CAPTURES[beside(scene).name].rig.kind
        for index in (0, 5):
            camera = cameras(scene.name)[index]
            kept = keep.read_images(beside(scene), index, camera.height)
            assert len(kept) == len(frames)
            for frame, true in zip(frames, kept, strict=True):
                error = image(frame, camera).colour - true / 255.0
                assert -10.0 * np.log10((error**2).mean()) > LEAST_PSNR[kind]
