"""How much lies before each Gaussian: cover classes, for steps that are coarser where less can be seen.

An estimate without cameras: from thirteen directions and their opposites, how much light reaches a Gaussian
through what lies before it, within a part of the scene's size. So what is buried in an object counts as
covered from everywhere, and a wall does not cover the room before it. An encoder's choice (spec section
9.6); floats are welcome here.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from dfcgs_codec.encoder.splats import alpha_of, deviations, rotation_matrices
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.lod import LevelsOfDetail

Int64 = npt.NDArray[np.int64]
Float64 = npt.NDArray[np.float64]

#: directions, each used both ways
_DIRECTIONS = np.array(
    [
        (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1),
        (1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1),
    ],
    np.float64,
)  # fmt: skip
#: images are so many cells wide, and light comes from so far, in parts of the scene's size
_CELLS = 120
_REACH = 0.2
#: a Gaussian wider than a cell is as many samples as cells, at most
_MAX_SAMPLES = 16
#: half octaves of a step to an octave of light: a covered Gaussian is not as coarse as its light alone
#: would have it, for the estimate is rough
_CLASSES_PER_OCTAVE = 1.0
_MOST = 10
_LEAST_LIGHT = 1e-3
#: classes that a neighbour's may be off
_NEAR = 0.9


def _samples(cloud: GaussianCloud, cell: float) -> tuple[Float64, Float64, Int64]:
    """Points (S, 3), the optical depth of each over a cell, and whose they are (S,), ascending."""
    scales = deviations(cloud.scales)
    _, middle, long = np.sort(scales, axis=1).T
    alpha = alpha_of(cloud.opacities)
    cells = 2 * np.pi * middle * long / cell**2
    number = np.clip(np.ceil(cells), 1, _MAX_SAMPLES).astype(np.int64)
    owner = np.repeat(np.arange(len(number)), number)
    noise = np.random.default_rng(0).standard_normal((len(owner), 3))
    # the first sample is the middle
    noise[np.cumsum(number) - number] = 0.0
    offsets = np.einsum("nij,nj->ni", rotation_matrices(cloud.rotations)[owner], noise * scales[owner])
    share = np.minimum(cells / number, 1.0)[owner]
    depth = -np.log1p(-np.minimum(alpha[owner] * share, 0.98))
    return cloud.positions.astype(np.float64)[owner] + offsets, depth, owner


def _light(depth: Float64, place: tuple[Int64, Float64], reach: float) -> tuple[Float64, Float64]:
    """Optical depth before and behind each sample, within `reach`; `place`: its cell, how far along."""
    cell, along = place
    # one number says where a sample is: cells lie farther apart than light reaches
    place_of = cell * (float(np.ptp(along)) + 2 * reach + 1.0) + (along - along.min() + reach)
    order = np.argsort(place_of, kind="stable")
    cells, key = cell[order], place_of[order]
    total = np.cumsum(depth[order])
    before = total - depth[order]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(cells)) + 1])
    lengths = np.diff(np.concatenate([starts, [len(cells)]]))
    first, end = np.repeat(starts, lengths), np.repeat(starts + lengths, lengths)
    near = np.maximum(np.searchsorted(key, key - reach), first)
    far = np.minimum(np.searchsorted(key, key + reach, side="right"), end)
    front, back = np.empty(len(cells)), np.empty(len(cells))
    front[order] = before - before[near]
    back[order] = total[far - 1] - total
    return front, back


def light(cloud: GaussianCloud) -> Float64:
    """Root mean square over directions of the share of light that reaches each Gaussian, (N,), 0 to 1."""
    corners = np.percentile(cloud.positions.astype(np.float64), [2, 98], axis=0)
    size = float((corners[1] - corners[0]).max())
    count = cloud.num_gaussians
    if not 0.0 < size < np.inf:
        return np.ones(count)
    cell = size / _CELLS
    points, depth, owner = _samples(cloud, cell)
    # far outliers share the cells at the border
    points = np.clip(points, corners[0] - size, corners[1] + size)

    def both_ways(direction: Float64) -> list[Float64]:
        """Light that reaches each Gaussian's samples, squared and summed, from there and from behind."""
        across = np.cross(direction, (0.31, 0.57, 0.76))
        across /= np.linalg.norm(across)
        u = np.floor(points @ across / cell).astype(np.int64)
        v = np.floor(points @ np.cross(direction, across) / cell).astype(np.int64)
        v -= v.min()
        cells = (u - u.min()) * (v.max() + 1) + v
        depths = _light(depth, (cells, points @ direction), _REACH * size)
        return [np.asarray(np.bincount(owner, np.exp(-2 * found), count), np.float64) for found in depths]

    total = np.zeros(count)
    directions = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
    with ThreadPoolExecutor(2) as beside:
        # summed in one order, whoever is first
        for found in beside.map(both_ways, directions):
            for squares in found:
                total += squares
    samples = np.bincount(owner, minlength=count)
    return np.sqrt(total / (2 * len(_DIRECTIONS) * samples))


def cover_of(light: Float64) -> Float64:
    """How covered each Gaussian is (N,), in classes, not rounded: 0 where as much can be seen as of any."""
    octaves = -np.log2(np.maximum(light, _LEAST_LIGHT))
    classes: Float64 = np.clip((octaves - np.quantile(octaves, 0.05)) * _CLASSES_PER_OCTAVE, 0.0, _MOST)
    return classes


def cover_classes(cover: Float64, lod: LevelsOfDetail) -> Int64:
    """Classes (N,) of `cover` (N,) in canonical order: those of the neighbours where they are near enough.

    An estimate so rough is not worth the bits of each rounding.
    """
    classes = np.rint(cover).astype(np.int64)
    for level in lod.levels:
        expected = (level.mean(classes) + 128) >> 8
        wanted = cover[level.rows]
        near = np.abs(wanted - expected) < _NEAR
        classes[level.rows] = np.where(near, expected, np.rint(wanted).astype(np.int64))
    return classes
