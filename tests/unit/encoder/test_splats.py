from __future__ import annotations

import numpy as np

from dfcgs_codec.encoder.images.splats import extent, harmonics, rotation_matrices


def test_harmonics_are_orthonormal() -> None:
    # Gauss-Legendre in z, equal steps about it: exact for products of degree 6
    heights, weights = np.polynomial.legendre.leggauss(8)
    turns = np.arange(16) * (2 * np.pi / 16)
    total = np.zeros((16, 16))
    for z, weight in zip(heights, weights, strict=True):
        for turn in turns:
            radius = np.sqrt(1 - z * z)
            (values,) = harmonics(np.array([[radius * np.cos(turn), radius * np.sin(turn), z]]), 16)
            total += weight * (2 * np.pi / 16) * np.outer(values, values)
    assert np.allclose(total, np.eye(16), atol=1e-12)
    assert harmonics(np.array([[0.0, 0.0, 1.0]] * 5), 4).shape == (5, 4)


def test_rotation_matrices_turn() -> None:
    half = np.sqrt(0.5)
    quarter_about_z = rotation_matrices(np.array([[half, 0, 0, half]]) * 3)
    assert np.allclose(quarter_about_z[0] @ [1, 0, 0], [0, 1, 0])
    some = rotation_matrices(np.random.default_rng(0).normal(size=(20, 4)))
    assert np.allclose(some @ some.transpose(0, 2, 1), np.eye(3))
    assert np.allclose(np.linalg.det(some), 1.0)


def test_the_extent_leaves_outliers_out() -> None:
    positions = np.random.default_rng(1).random((1000, 3)) * [1, 5, 2]
    positions[:3] = 1e6
    assert 4.5 < extent(positions) < 5.0
