from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.encoder.matching.identity import is_tracked
from dfcgs_codec.gaussians import GaussianCloud
from lab.small_clouds import coincident_cloud, make_cloud, real_cloud, shuffled, travelling, with_outliers


def moved(cloud: GaussianCloud, distance: float) -> GaussianCloud:
    noise = np.random.default_rng(1).normal(size=cloud.positions.shape).astype(np.float32)
    return replace(cloud, positions=cloud.positions + np.float32(distance) * noise)


@pytest.mark.parametrize("count", [2, 3, 33, 1000, 10_000])
def test_a_little_motion_is_tracked(count: int) -> None:
    cloud = make_cloud(count)
    assert is_tracked(cloud, cloud)
    assert is_tracked(cloud, moved(cloud, 0.02))


@pytest.mark.parametrize("count", [33, 1000, 10_000])
def test_another_order_is_not(count: int) -> None:
    cloud = make_cloud(count)
    assert not is_tracked(cloud, shuffled(cloud))
    assert not is_tracked(cloud, make_cloud(count, 0, 1))


def test_a_trained_scene() -> None:
    cloud = real_cloud(2000)
    assert is_tracked(cloud, moved(cloud, 0.01))
    assert not is_tracked(cloud, shuffled(cloud))


def test_another_count_is_not() -> None:
    cloud = make_cloud(100)
    assert not is_tracked(cloud, cloud.take(np.arange(99)))


@pytest.mark.parametrize("distance", [0.5, 3.0, 100.0])
def test_a_motion_of_the_whole_scene_is_tracked(distance: float) -> None:
    first, second = travelling(make_cloud(500), 2, distance)
    assert is_tracked(first, second)


def test_outliers_do_not_decide() -> None:
    cloud = with_outliers(make_cloud(500), 5)
    assert is_tracked(cloud, moved(cloud, 0.02))
    assert not is_tracked(cloud, shuffled(cloud))


def test_a_single_gaussian_and_coincident_ones_that_stand_still_are_tracked() -> None:
    for cloud in (make_cloud(1), coincident_cloud(100)):
        assert is_tracked(cloud, cloud)
