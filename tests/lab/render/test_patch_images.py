"""What the encoder sees in its patches is what the renderer of the evaluation draws there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from dfcgs_codec.encoder.images.patches import patches_of_views
from dfcgs_codec.encoder.images.seen import largest_weights
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.views.camera import ViewCamera
from lab.quality import Image, image
from lab.render import Camera
from lab.small_clouds import real_cloud
from lab.small_room import looking, room, viewers

NEAR = 0.01
#: 8 x 8 pixels, every second one
PLACES = np.arange(8) * 2


def uneven_room() -> GaussianCloud:
    """No two equally deep, which may be drawn in any order; and renderers differ in the largest opacity."""
    cloud = room()
    moved = cloud.positions + np.random.default_rng(0).normal(0, 0.005, cloud.positions.shape)
    return replace(cloud, positions=moved.astype(np.float32), opacities=np.minimum(cloud.opacities, 2))


SCENES = {
    "room": (uneven_room(), list(viewers().cameras[:3])),
    "object": (
        real_cloud(3000),
        [looking((1.5, 0.8, -1.8), (0, 0, 0)), looking((-2, 0.3, 0.5), (0, 0.2, 0))],
    ),
}


def rendered(cloud: GaussianCloud, view: ViewCamera) -> Image:
    camera = Camera(view.world_to_camera, view.fx, view.fy, view.cx, view.cy, view.width, view.height)
    return image(cloud, camera)


@pytest.mark.parametrize("name", SCENES)
def test_patches_are_parts_of_rendered_images(name: str) -> None:
    cloud, cameras = SCENES[name]
    splats = Splats.of(cloud)
    images = {camera: rendered(cloud, camera).colour for camera in cameras}
    shown = 0
    for patch in patches_of_views(splats, cameras, NEAR):
        found = patch.draw(splats.take(patch.rows)).image().reshape(8, 8, 3)
        columns, rows = (int(patch.corner[axis]) + PLACES for axis in (0, 1))
        # the first axis of a patch is that of columns
        wanted = images[patch.camera][rows][:, columns].transpose(1, 0, 2)
        assert np.abs(found - wanted).max() < 0.005
        shown += wanted.max() > 0.1
    assert shown > 10


@pytest.mark.parametrize("name", SCENES)
def test_weights_add_up_to_the_opacity_of_images(name: str) -> None:
    cloud, cameras = SCENES[name]
    for camera in cameras:
        opacity = float(rendered(cloud, camera).alpha.sum())
        assert largest_weights(Splats.of(cloud), [camera], NEAR).sum() == pytest.approx(opacity, rel=0.05)
