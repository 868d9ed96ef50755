"""Patches: few pixels, and who shows there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.encoder.images.patches import PATCHES, Patch, patches_nearby, patches_of_views
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import coincident_cloud, joined, make_cloud, real_cloud, with_outliers
from lab.small_room import NUM_WALLS, gaussians, inside, looking, room, viewers

NEAR = 0.01


def images(splats: Splats, patches: list[Patch]) -> np.ndarray:
    return np.array([patch.draw(splats.take(patch.rows)).image() for patch in patches])


def test_an_object_is_looked_at_from_all_around() -> None:
    splats = Splats.of(real_cloud(3000))
    patches = patches_nearby(splats)
    assert len(patches) == PATCHES
    shown = images(splats, patches)
    assert shown.shape == (PATCHES, 64, 3)
    assert ((shown >= 0) & (shown <= 1)).all()
    assert (shown.max(axis=(1, 2)) > 0.05).mean() > 0.9
    forward = np.array([patch.camera.forward for patch in patches])
    assert np.abs(forward.mean(axis=0)).max() < 0.05
    again = patches_nearby(splats)
    assert all(np.array_equal(a.rows, b.rows) for a, b in zip(patches, again, strict=True))


def test_rows_are_those_that_show() -> None:
    """Without the others a patch looks the same, and each of them adds something."""
    splats = Splats.of(room())
    for patch in patches_of_views(splats, viewers().cameras, NEAR)[::8]:
        assert (np.diff(patch.rows) > 0).all()
        whole = Patch(patch.camera, patch.corner, NEAR, np.arange(len(splats.alpha)))
        found, wanted = images(splats, [patch]), images(splats, [whole])
        assert np.abs(found - wanted).max() < 0.02
        assert patch.draw(splats.take(patch.rows)).alphas.max(axis=1).min() > 0


def test_what_is_behind_a_wall_shows_in_no_patch() -> None:
    splats = Splats.of(room())
    rows = np.concatenate([patch.rows for patch in patches_of_views(splats, viewers().cameras, NEAR)])
    assert rows.max() < NUM_WALLS + 40
    assert np.isin(np.arange(NUM_WALLS, NUM_WALLS + 40), rows).mean() > 0.5


def test_patches_lie_in_the_images_of_all_cameras() -> None:
    cameras = [looking((0, 0, -5), (0, 0, 0), size) for size in ((160, 120), (40, 20), (7, 3))]
    patches = patches_of_views(Splats.of(make_cloud(100)), cameras, NEAR)
    assert len(patches) == PATCHES
    for camera in cameras:
        corners = np.array([patch.corner for patch in patches if patch.camera is camera])
        assert len(corners) == PATCHES // 3
        assert corners.min() >= 0
        most = np.maximum(np.array([camera.width, camera.height]) - 16, 1)
        assert (corners < most).all()


def test_the_nearest_hides_the_others() -> None:
    cloud = gaussians(np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 3]]), 0.5, 0.99)
    cloud.sh_dc[:] = np.array([[-2, -2, -2], [2, 2, 2], [-2, -2, -2]])
    splats = Splats.of(cloud)
    patch = Patch(looking((0, 0, -5), (0, 0, 0)), np.array([73.0, 53.0]), NEAR, np.arange(3))
    drawing = patch.draw(splats)
    assert np.argsort(drawing.depth).tolist() == [1, 0, 2]
    assert drawing.image().mean() > 0.9
    assert drawing.image(np.array([0, 1, 2])).mean() < 0.4


@pytest.mark.parametrize("cloud", [make_cloud(1), coincident_cloud(40), make_cloud(2).take(np.array([0, 0]))])
def test_a_scene_without_a_size_has_no_patches(cloud: GaussianCloud) -> None:
    assert patches_nearby(Splats.of(cloud)) == []


def test_nothing_shows_of_what_is_transparent() -> None:
    clear = replace(make_cloud(60), opacities=np.full(60, -40, np.float32))
    splats = Splats.of(clear)
    for patches in (patches_nearby(splats), patches_of_views(splats, viewers().cameras, NEAR)):
        assert sum(len(patch.rows) for patch in patches) == 0
        assert (images(splats, patches) == 0).all()


WILD = {
    "large": lambda cloud: cloud.scales.fill(80),
    "small": lambda cloud: cloud.scales.fill(-80),
    "needles": lambda cloud: cloud.scales[:, 0].fill(80),
    "opaque": lambda cloud: cloud.opacities.fill(1e30),
    "glaring": lambda cloud: cloud.sh_dc.fill(1e30),
    "far": lambda cloud: np.multiply(cloud.positions, np.float32(1e30), out=cloud.positions),
    "near": lambda cloud: np.multiply(cloud.positions, np.float32(1e-30), out=cloud.positions),
    "some not a number": lambda cloud: cloud.scales[::7].fill(np.nan),
}


@pytest.mark.parametrize("name", WILD)
def test_wild_values_are_drawn_all_the_same(name: str) -> None:
    wild = make_cloud(60)
    WILD[name](wild)
    for cloud in (wild, joined(inside(), wild), joined(inside(), with_outliers(wild, 3, 1e12))):
        splats = Splats.of(cloud)
        with np.errstate(all="ignore"):
            for patches in (patches_nearby(splats), patches_of_views(splats, viewers().cameras, NEAR)):
                assert np.isfinite(images(splats, patches)).all()


def test_positions_that_are_no_numbers_are_not_looked_at() -> None:
    cloud = make_cloud(60)
    cloud.positions[5] = np.nan
    assert patches_nearby(Splats.of(cloud)) == []
