"""How much Gaussians add to images: blending weights along rays, transmittance included.

Each image is looked at along a grid of rays, through exact pixels, moved at random from image to image. Pairs
of ray and Gaussian are sorted by ray, front to back, and sums of optical depths say how much light passes.
An encoder's choice; floats are welcome here.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int32, Int64, UInt16
from dfcgs_codec.encoder.images.projection import LEAST_ALPHA, MOST_ALPHA, Ellipses, project
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.views.camera import ViewCamera

#: rays along the longer side of an image: with 48, Gaussians that show between them cost 7 dB at 50 dB
_RAYS = 64


@dataclass(frozen=True)
class _Grid:
    """Rays of an image: pixel of the `first` (2,), pixels from one to the next, columns and rows (2,)."""

    first: Float64
    spacing: float
    shape: Int64


def _pairs(middle: Float64, reach: Float64, grid: _Grid) -> tuple[Int64, Int32, Int32]:
    """How many rays may hit each Gaussian (N,), and columns and rows of these, Gaussian after Gaussian."""
    first, spacing, shape = grid.first, grid.spacing, grid.shape
    low = np.clip(np.ceil((middle - reach - first) / spacing), 0, shape)
    high = np.clip(np.floor((middle + reach - first) / spacing) + 1, 0, shape)
    # an image has few rays: half the bytes are half the time
    low, high = np.nan_to_num(low).astype(np.int32), np.nan_to_num(high).astype(np.int32)
    sides = np.maximum(high - low, 0)
    counts = sides[:, 0].astype(np.int64) * sides[:, 1]
    starts = np.repeat((np.cumsum(counts) - counts).astype(np.int32), counts)
    within = np.arange(len(starts), dtype=np.int32) - starts
    widths = np.repeat(sides[:, 0], counts)
    rows = within // widths
    columns = within - rows * widths
    return counts, columns + np.repeat(low[:, 0], counts), rows + np.repeat(low[:, 1], counts)


def _alphas(ellipses: Ellipses, alpha: Float64, counts: Int64, points: tuple[Float64, Float64]) -> Float32:
    """Opacity of each Gaussian (N,) at so many `counts` (N,) of `points`, (P,) each."""
    half = 0.5 / (ellipses.a * ellipses.c - ellipses.b**2)
    shape = (ellipses.c * half, 2 * ellipses.b * half, ellipses.a * half, alpha)
    a, b, c, most = (np.repeat(k.astype(np.float32), counts) for k in shape)
    u, v = ((p - np.repeat(ellipses.middle[:, i], counts)).astype(np.float32) for i, p in enumerate(points))
    found: Float32 = most * np.exp(-(a * u * u - b * u * v + c * v * v))
    found[~(found >= LEAST_ALPHA)] = 0.0
    np.minimum(found, np.float32(MOST_ALPHA), out=found)
    return found


def _light(ray: UInt16, alphas: Float32) -> Float32:
    """The share of light (P,) that passes what lies before; pairs sorted by `ray`, front to back."""
    depth = -np.log1p(-alphas.astype(np.float64))
    before = np.cumsum(depth) - depth
    starts = np.flatnonzero(np.diff(ray.astype(np.int32), prepend=-1))
    lengths = np.diff(np.concatenate([starts, [len(ray)]]))
    before -= np.repeat(before[starts], lengths)
    light: Float32 = np.exp(-before).astype(np.float32)
    return light


def _of_image(splats: Splats, camera: ViewCamera, near: float, offset: Float64) -> Float64:
    ellipses = project(splats, camera, near)
    sides = np.array([camera.width, camera.height])
    spacing = max(1.0, float(sides.max()) / _RAYS)
    grid = _Grid(np.floor(offset * spacing) + 0.5, spacing, np.maximum(sides // spacing, 1).astype(np.int64))
    nearest_first = np.argsort(ellipses.depth, kind="stable")
    alpha, ellipses = splats.alpha[nearest_first], ellipses.take(nearest_first)
    counts, columns, rows = _pairs(ellipses.middle, ellipses.reach(alpha), grid)
    points = grid.first[0] + columns * spacing, grid.first[1] + rows * spacing
    alphas = _alphas(ellipses, alpha, counts, points)
    hit = np.flatnonzero(alphas)
    # numbers of 16 bits are sorted in one pass, and stay front to back within a ray
    ray = (rows[hit] * np.int32(grid.shape[0]) + columns[hit]).astype(np.uint16)
    pairs = np.argsort(ray, kind="stable")
    alphas = alphas[hit][pairs]
    added = alphas * _light(ray[pairs], alphas)
    owner = np.repeat(nearest_first, counts)[hit][pairs]
    total = np.bincount(owner, added, len(splats.alpha)).astype(np.float64)
    return total * (spacing * spacing)


def largest_weights(splats: Splats, cameras: Iterable[ViewCamera], near: float, seed: int = 0) -> Float64:
    """What each Gaussian adds to the images of `cameras` (N,), in pixels: the largest of all images.

    `near`: scene units; rays lie elsewhere for another `seed`.
    """
    random = np.random.default_rng(seed)
    views = [(camera, random.random(2)) for camera in cameras]

    # scales of +-80 leave the range of floats: these Gaussians are seen nowhere
    @np.errstate(all="ignore")
    def look(view: tuple[ViewCamera, Float64]) -> Float64:
        return np.nan_to_num(_of_image(splats, view[0], near, view[1]))

    largest = np.zeros(len(splats.alpha))
    with ThreadPoolExecutor(2) as beside:
        for added in beside.map(look, views):
            np.maximum(largest, added, out=largest)
    return largest
