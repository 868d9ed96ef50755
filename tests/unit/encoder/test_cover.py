from __future__ import annotations

from dataclasses import replace

import numpy as np

from dfcgs_codec.encoder.cover import cover_classes, cover_of, light
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.lod import build_levels
from tests.helpers import make_cloud


def cloud_at(positions: np.ndarray, size: float, alpha: float) -> GaussianCloud:
    count = len(positions)
    logit = np.log(alpha / (1 - alpha))
    return replace(
        make_cloud(count),
        positions=positions.astype(np.float32),
        scales=np.full((count, 3), np.log(size), np.float32),
        opacities=np.full_like(make_cloud(count).opacities, logit),
    )


def sphere(count: int, radius: float, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * radius


def ball(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points all over a ball, and how far out each is."""
    radii = np.random.default_rng(9).random(count) ** (1 / 3)
    return sphere(count, 1.0) * radii[:, None], radii


def test_what_is_inside_an_opaque_ball_is_covered() -> None:
    points, radii = ball(12_000)
    found = light(cloud_at(points, 0.03, 0.95))
    assert np.median(found[radii < 0.6]) < 0.5 * np.median(found[radii > 0.97])
    classes = cover_of(light(cloud_at(points, 0.03, 0.95)))
    assert np.median(classes[radii < 0.6]) > np.median(classes[radii > 0.97]) + 1
    assert classes.min() == 0


def test_a_thin_haze_covers_little() -> None:
    points, radii = ball(12_000)
    found = light(cloud_at(points, 0.03, 0.005))
    assert np.median(found[radii < 0.6]) > 0.8 * np.median(found[radii > 0.97])


def test_a_far_wall_covers_nothing() -> None:
    """Who stands in a room sees it: walls farther than a part of its size count as not there."""
    rng = np.random.default_rng(4)
    walls = rng.uniform(-1, 1, (12000, 3))
    sides = np.arange(12000) % 3
    walls[np.arange(12000), sides] = np.where(rng.random(12000) < 0.5, -1, 1)
    table = rng.normal(0, 0.15, (50, 3))
    found = light(cloud_at(np.concatenate([walls, table]), 0.02, 0.95))
    assert np.median(found[12000:]) > np.median(found[:12000])


def test_any_cloud_has_classes() -> None:
    for cloud in (make_cloud(1), make_cloud(2), cloud_at(np.zeros((40, 3)), 1.0, 0.5)):
        assert (np.rint(cover_of(light(cloud))) == 0).all()
    wild = cloud_at(sphere(300, 1e6), 1e-9, 0.999)
    wild.positions[0] = 1e30
    assert np.isfinite(cover_of(light(wild))).all()


def test_classes_follow_their_neighbours_where_these_are_near() -> None:
    rng = np.random.default_rng(0)
    wanted = np.clip(rng.normal(3, 0.4, 4000), 0, 10)
    wanted[::50] = 9.0
    lod = build_levels(np.stack([np.arange(4000)] * 3, axis=1))
    found = cover_classes(wanted, lod)
    assert np.abs(found - wanted).max() < 1.0
    # fewer changes than rounding makes
    assert np.count_nonzero(np.diff(found)) < 0.8 * np.count_nonzero(np.diff(np.rint(wanted)))
