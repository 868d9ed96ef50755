"""How much Gaussians add to images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.encoder.images.seen import largest_weights
from dfcgs_codec.encoder.images.splats import Splats
from lab.small_clouds import joined, make_cloud
from lab.small_room import NUM_WALLS, gaussians, looking, room, viewers

AHEAD = looking((0, 0, -5), (0, 0, 0), (480, 360), 400.0)
NEAR = 0.01


def weights(*points: tuple[float, float, float], deviation: float = 0.4, alpha: float = 0.9) -> np.ndarray:
    return largest_weights(Splats.of(gaussians(np.array(points), deviation, alpha)), [AHEAD], NEAR)


@pytest.mark.parametrize("alpha", [0.3, 0.9])
def test_a_lone_gaussian_adds_its_area(alpha: float) -> None:
    # deviations of 0.4 at a distance of 5 are 32 pixels
    (found,) = weights((0, 0, 0), alpha=alpha)
    assert found == pytest.approx(alpha * 2 * np.pi * 32**2, rel=0.05)
    (farther,) = weights((0, 0, 5), alpha=alpha)
    assert farther == pytest.approx(found / 4, rel=0.05)


def test_what_is_not_in_the_image_adds_nothing() -> None:
    aside, above, after, near = weights(
        (40, 0, 0), (0, 30, 0), (0, 0, -9), (0, 0, -5 + NEAR / 2), deviation=0.01
    )
    assert (aside, above, after, near) == (0, 0, 0, 0)


def test_what_is_nearer_than_near_is_not_drawn() -> None:
    splats = Splats.of(gaussians(np.array([[0.0, 0, -3]]), 0.4, 0.9))
    assert largest_weights(splats, [AHEAD], 1.9)[0] > 0
    assert largest_weights(splats, [AHEAD], 2.1)[0] == 0


def test_what_never_reaches_the_least_opacity_adds_nothing() -> None:
    assert weights((0, 0, 0), alpha=0.9 / 255)[0] == 0


def test_who_stands_before_takes_light() -> None:
    alone = weights((0, 0, 2))[0]
    before, behind = weights((0, 0, -1), (0, 0, 2))
    assert behind < 0.35 * alone
    assert before == pytest.approx(weights((0, 0, -1))[0])
    # whatever the order of rows
    assert weights((0, 0, 2), (0, 0, -1)) == pytest.approx([behind, before])


def test_a_wall_hides_what_is_behind_it() -> None:
    views = viewers()
    found = largest_weights(Splats.of(room()), views.cameras, NEAR)
    assert found[: NUM_WALLS + 40].min() > 0
    assert found[NUM_WALLS + 40 :].max() < 0.02 * np.median(found[NUM_WALLS : NUM_WALLS + 40])


def test_the_largest_of_all_images_counts() -> None:
    splats = Splats.of(make_cloud(200))
    cameras = [AHEAD, looking((5, 0, 0), (0, 0, 0))]
    both = largest_weights(splats, cameras, NEAR)
    # the offsets of rays depend on the place in the list
    assert (both >= largest_weights(splats, cameras[:1], NEAR)).all()
    assert largest_weights(splats, [], NEAR).tolist() == [0.0] * 200


def test_the_same_input_gives_the_same_weights() -> None:
    splats, cameras = Splats.of(room()), viewers().cameras
    found = [largest_weights(splats, cameras, NEAR, seed) for seed in (0, 0, 1)]
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])
    large = found[0] > 100
    assert found[2][large] == pytest.approx(found[0][large], rel=0.5)


@pytest.mark.filterwarnings("error")
def test_wild_values_spoil_nothing_for_others() -> None:
    cloud = make_cloud(20)
    wild = make_cloud(8)
    wild.scales[0], wild.scales[1], wild.scales[2, 0] = 80, -80, np.nan
    wild.positions[3], wild.positions[4] = 1e30, np.nan
    wild.opacities[5], wild.opacities[6] = np.inf, np.nan
    wild.rotations[7] = np.nan
    # the one of a huge scale stands before all others
    wild.opacities[0] = -80
    found = largest_weights(Splats.of(joined(cloud, wild)), [AHEAD], NEAR)
    assert np.isfinite(found).all()
    alone = largest_weights(Splats.of(joined(cloud, wild.take(np.array([1, 5])))), [AHEAD], NEAR)
    assert found[:20] == pytest.approx(alone[:20], rel=0.01)


def test_no_gaussians_have_no_weights() -> None:
    nobody = replace(make_cloud(3)).take(np.zeros(0, np.int64))
    assert largest_weights(Splats.of(nobody), [AHEAD], NEAR).shape == (0,)
