"""Who shows from where viewers stand, and who is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.encoder.images.patches import patches_of_views
from dfcgs_codec.encoder.images.shown import ALL, Region, Seen, Shown, error_without, least_weight
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.sequence import MemorySource
from dfcgs_codec.views.camera import Views
from lab.small_clouds import make_cloud, same_cloud
from lab.small_room import NUM_WALLS, looking, room, viewers

BEFORE = slice(NUM_WALLS, NUM_WALLS + 40)
BEHIND = slice(NUM_WALLS + 40, None)
ASKED = 1e-4


def region(keeps_unseen: bool = False) -> Region:
    return Region.of(viewers(), 0.15, room().positions.astype(np.float64), keeps_unseen)


def test_cameras_that_look_and_those_that_judge_are_others() -> None:
    found = region()
    assert len(found.cameras) > len(found.judges) > 3
    assert not set(found.cameras) & set(found.judges)
    alone = Region.of(Views(viewers().cameras[:1]), 0.0, np.zeros((3, 3)), False)
    assert list(alone.cameras) == list(alone.judges) == [viewers().cameras[0]]


def test_large_images_are_looked_at_in_fewer_pixels() -> None:
    views = Views((looking((0, 0, -5), (0, 0, 0), (8000, 6000), 5000.0),))
    (camera, *_) = Region.of(views, 0.15, np.eye(3), False).cameras
    assert (camera.width, camera.height) == (1600, 1200)


def test_what_is_behind_the_wall_is_left_out() -> None:
    splats = Splats.of(room())
    found = region()
    weights = found.weights(splats)
    seen = found.leaving_out(splats, weights, ASKED).seen(weights)
    assert seen.rows is not None
    assert seen.cover is None
    is_kept = np.isin(np.arange(len(weights)), seen.rows)
    assert is_kept[:NUM_WALLS].mean() > 0.8
    assert is_kept[BEFORE].all()
    assert not is_kept[BEHIND].any()
    assert seen.num_left_out == np.count_nonzero(~is_kept)
    assert same_cloud(seen.of(room()), room().take(seen.rows))


def test_what_is_behind_the_wall_is_kept_in_coarse_steps() -> None:
    splats = Splats.of(room())
    found = region(keeps_unseen=True)
    weights = found.weights(splats)
    seen = found.leaving_out(splats, weights, ASKED).seen(weights)
    assert seen.rows is None
    assert seen.num_left_out == 0
    assert seen.cover is not None
    assert set(seen.cover.tolist()) == {0, 6}
    assert (seen.cover[BEFORE] == 0).all()
    assert (seen.cover[BEHIND] == 6).all()


@pytest.mark.parametrize("asked", [1e-7, 1e-5, 1e-3])
def test_errors_are_no_larger_than_asked(asked: float) -> None:
    splats = Splats.of(room())
    found = region()
    weights = found.weights(splats)
    left = found.leaving_out(splats, weights, asked)
    assert 0.0 <= left.error <= asked
    is_out = weights < left.least
    # seen by others than those who chose
    others = [looking((0.2, 0.1 * i, -0.1), np.array([np.cos(i), 0.3, np.sin(i)]).tolist()) for i in range(6)]
    assert error_without(splats, is_out, patches_of_views(splats, others, left.near)) <= 4 * asked


def test_more_is_left_out_for_a_larger_error() -> None:
    splats = Splats.of(room())
    found = region()
    weights = found.weights(splats)
    counts = [
        found.leaving_out(splats, weights, asked).seen(weights).num_left_out for asked in (1e-7, 1e-4, 3e-3)
    ]
    assert counts == sorted(counts)
    assert counts[0] >= 60
    assert counts[-1] > counts[0]


def test_errors_of_nobody_and_of_everybody() -> None:
    splats = Splats.of(room())
    patches = region().patches(splats)
    count = len(splats.alpha)
    assert error_without(splats, np.zeros(count, bool), patches) == 0.0
    images = [patch.draw(splats.take(patch.rows)).image() for patch in patches]
    everything = np.mean([np.mean(image.astype(np.float64) ** 2) for image in images])
    assert error_without(splats, np.ones(count, bool), patches) == pytest.approx(everything, rel=1e-6)
    assert error_without(splats, np.ones(count, bool), []) == 0.0


def test_the_least_weight_is_a_limit_below_which_errors_fit() -> None:
    splats = Splats.of(room())
    found = region()
    weights, patches = found.weights(splats), found.patches(splats)
    least = least_weight(splats, weights, patches, ASKED)
    assert error_without(splats, weights < least, patches) <= ASKED
    assert error_without(splats, weights < 4 * least, patches) > ASKED
    assert least_weight(splats, np.zeros(len(weights)), patches, ASKED) == 0.0
    # who shows is not to be left out, whoever did not see it
    assert least_weight(splats, np.where(weights > 50, 0.0, weights), patches, ASKED) == 0.0


def test_a_frame_where_nothing_shows_keeps_all() -> None:
    away = Views((looking((0, 0, -9), (0, 0, -20)),))
    found = Region.of(away, 0.0, room().positions.astype(np.float64), False)
    splats = Splats.of(room())
    weights = found.weights(splats)
    assert not weights.any()
    found = found.leaving_out(splats, weights, ASKED)
    assert found.seen(weights) == ALL
    assert found.seen(np.ones(5)) == ALL


def test_what_is_planned_for_a_run_holds_for_its_tracked_frames_alone() -> None:
    cloud = room()
    other = make_cloud(cloud.num_gaussians, seed=3)
    source = MemorySource([cloud, replace(cloud, positions=cloud.positions + np.float32(0.01)), other])
    planned = Seen(np.arange(7), None, cloud.num_gaussians - 7)
    shown = Shown(source, region(), [0, 0, 0], {0: planned})
    assert shown.of(0, cloud) is planned
    assert shown.of(1, source.read(1)[0]) is planned
    assert shown.of(2, other) is not planned
    assert Shown(source, None, [0, 0, 0], {}).of(0, cloud) == ALL
    assert shown.of(0, cloud.take(np.zeros(0, np.int64))) == ALL
