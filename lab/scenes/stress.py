"""Sequences that break codecs. Each case is a variant: it takes clean frames and a seed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice

import numpy as np

from dfcgs_codec.array_types import Float32, Float64
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from lab.scenes import rotations
from lab.scenes.fields import field_for, scene_size
from lab.scenes.options import SceneOptions
from lab.scenes.trained import trained_sequence

#: keep the random numbers apart from those of other stages with the same seed
STRESS_STREAM, BLOB_STREAM = 41, 42
#: how far out the outliers are, in sizes of the scene
OUTLIER_DISTANCE = 1000.0
#: share of the Gaussians that are outliers, or huge, or tiny
ODD_SHARE = 0.01
#: log-scales of huge and tiny Gaussians relative to the scene's size: e^4 = 55 times it, and 1e-9 of it
HUGE, TINY = 4.0, -20.7
#: coincident Gaussians
NUM_COINCIDENT = 200_000
#: first frame after the cut
CUT = 4


def _odd_ones(count: int, rng: np.random.Generator, groups: int) -> list[np.ndarray]:
    """Disjoint random sets of ODD_SHARE of the indices each, at least one where there are enough."""
    size = max(1, round(ODD_SHARE * count))
    order = rng.permutation(count)
    return [order[i * size : (i + 1) * size] for i in range(groups)]


def far_outliers(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """1 % stand still 1000 sizes away, in all directions."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    places: Float64 | None = None
    for frame in frames:
        if places is None:
            (odd,) = _odd_ones(frame.num_gaussians, rng, 1)
            direction = rng.standard_normal((len(odd), 3))
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            distance = OUTLIER_DISTANCE * scene_size(frame.positions) * rng.uniform(0.9, 1.1, (len(odd), 1))
            places = frame.positions.mean(axis=0) + distance * direction
        positions = frame.positions.copy()
        positions[odd] = places
        yield replace(frame, positions=positions)


def extreme_scales(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """1 % are 55 times larger than the scene, 1 % a billion times smaller."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    scales: Float32 | None = None
    for frame in frames:
        if scales is None:
            huge, tiny = _odd_ones(frame.num_gaussians, rng, 2)
            size = np.log(scene_size(frame.positions))
            scales = frame.scales.copy()
            scales[huge], scales[tiny] = size + HUGE, size + TINY
        yield replace(frame, scales=scales)


def large_motion(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """Everything moves by 1.5 sizes from frame to frame, in a new direction each time."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    offset = np.zeros(3)
    size = 0.0
    for frame in frames:
        size = size or scene_size(frame.positions)
        yield replace(frame, positions=(frame.positions + offset).astype(np.float32))
        direction = rng.standard_normal(3)
        offset += 1.5 * size * direction / np.linalg.norm(direction)


def scene_cut(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """From frame 4 on another scene: three quarters of the Gaussians, shuffled, turned, of other colours."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    stream = iter(frames)
    yield from islice(stream, CUT)
    turn = rotations.from_vectors(rng.uniform(1.0, 2.0, (1, 3)))
    order = None
    for frame in stream:
        if order is None:
            n = frame.num_gaussians
            order = rng.permutation(n)[: max(1, round(0.75 * n))]
            middle = frame.positions.mean(axis=0)
        other = frame.take(order)
        yield replace(
            other,
            positions=(middle + rotations.rotate(turn, other.positions - middle)).astype(np.float32),
            rotations=rotations.multiply(turn, other.rotations).astype(np.float32),
            sh_dc=-other.sh_dc[:, [2, 0, 1]],
        )


def sign_flips(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """A random half of the quaternions is negated in each frame: the same rotations in other numbers."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    for frame in frames:
        signs = rng.choice(np.array([-1.0, 1.0], np.float32), (frame.num_gaussians, 1))
        yield replace(frame, rotations=signs * frame.rotations)


def coincident(
    frames: Iterable[GaussianCloud], seed: int, count: int = NUM_COINCIDENT
) -> Iterator[GaussianCloud]:
    """`count` Gaussians, all in the place of the scene's first one; other attributes repeat the scene's."""
    del seed
    for frame in frames:
        cloud = frame.take(np.arange(count) % frame.num_gaussians)
        yield replace(cloud, positions=np.tile(frame.positions[:1], (count, 1)))


def single(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """N = 1: the Gaussian 0 alone."""
    del seed
    for frame in frames:
        yield frame.take(np.array([0]))


def static(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """The first frame again and again."""
    del seed
    stream = iter(frames)
    for first in stream:
        yield from (first for _ in chain([first], stream))


def alternating(frames: Iterable[GaussianCloud], seed: int) -> Iterator[GaussianCloud]:
    """A B A B ...: A is the first frame, B the same with everything displaced by up to 5 % of the size."""
    rng = np.random.default_rng([seed, STRESS_STREAM])
    states: list[GaussianCloud] = []
    for index, frame in enumerate(frames):
        if not states:
            push = field_for(frame, rng, 3, wavelength=0.7)(frame.positions)
            push *= 0.05 * scene_size(frame.positions) / np.abs(push).max()
            states = [frame, replace(frame, positions=(frame.positions + push).astype(np.float32))]
        yield states[index % 2]


#: the stress cases by name: variants of any sequence, and scenes of their own on a blob
STRESS: dict[str, Callable[[Iterable[GaussianCloud], int], Iterator[GaussianCloud]]] = {
    "outliers": far_outliers,
    "extreme-scales": extreme_scales,
    "large-motion": large_motion,
    "scene-cut": scene_cut,
    "sign-flips": sign_flips,
    "coincident": coincident,
    "single": single,
    "static": static,
    "alternating": alternating,
}


def blob_cloud(num_gaussians: int, sh_degree: int, seed: int) -> GaussianCloud:
    """A ball of radius 1 without any asset: positions (N, 3) denser inside, random flat Gaussians."""
    rng = np.random.default_rng([seed, BLOB_STREAM])
    n, spacing = num_gaussians, num_gaussians ** (-1.0 / 3.0)
    direction = rng.standard_normal((n, 3))
    radius = rng.random((n, 1)) ** 0.5 / np.linalg.norm(direction, axis=1, keepdims=True)
    scales = np.log(spacing) + rng.normal([-0.3, -0.7, -1.5], 0.4, (n, 3))
    coefficients = SH_REST_COEFFICIENTS[sh_degree]
    return GaussianCloud(
        positions=(radius * direction).astype(np.float32),
        rotations=rotations.normalised(rng.standard_normal((n, 4))).astype(np.float32),
        scales=scales.astype(np.float32),
        opacities=rng.normal(1.0, 1.5, n).astype(np.float32),
        sh_dc=(1.0 * np.tanh(2.0 * radius * direction) + rng.normal(0.0, 0.2, (n, 3))).astype(np.float32),
        sh_rest=rng.normal(0.0, 0.08, (n, 3, coefficients)).astype(np.float32),
    )


def stress_sequence(name: str, options: SceneOptions | None = None) -> Iterator[GaussianCloud]:
    """Frames of the stress case `name`, on a swaying blob."""
    options = options or SceneOptions()
    blob = blob_cloud(options.surface_gaussians, options.surface_sh_degree, options.seed)
    return STRESS[name](trained_sequence(blob, options, "sway"), options.seed)
