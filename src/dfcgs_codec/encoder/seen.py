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
import numpy.typing as npt

from dfcgs_codec.encoder.projection import LEAST_ALPHA, MOST_ALPHA, Ellipses, project
from dfcgs_codec.encoder.splats import Splats
from dfcgs_codec.views.camera import ViewCamera

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]

#: rays along the longer side of an image
_RAYS = 48
#: what few rays hit counts as much as so many rays would say of its opacity, size and light alone
_TRUSTED_RAYS = 4.0


@dataclass(frozen=True)
class Weights:
    """What each Gaussian adds to images, (N,) each, in pixels.

    `largest`: the sum over an image of what it adds, largest of all images; `squared`: the sum of squares,
    mean over images.
    """

    largest: Float64
    squared: Float64

    def __or__(self, other: Weights) -> Weights:
        """The larger ones of these and those."""
        return Weights(np.maximum(self.largest, other.largest), np.maximum(self.squared, other.squared))


def _pairs(
    ellipses: Ellipses, reach: Float64, grid: tuple[Float64, float, Int64]
) -> tuple[Int64, Int64, Int64]:
    """Gaussians and columns and rows of the rays that may hit them; `grid`: first ray, spacing, (columns, rows).

    Gaussians ascend.
    """
    first, spacing, shape = grid
    low = np.clip(np.ceil((ellipses.middle - reach - first) / spacing), 0, shape)
    high = np.clip(np.floor((ellipses.middle + reach - first) / spacing) + 1, 0, shape)
    low, high = np.nan_to_num(low).astype(np.int64), np.nan_to_num(high).astype(np.int64)
    sides = np.maximum(high - low, 0)
    counts = sides[:, 0] * sides[:, 1]
    owner = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = within // np.maximum(sides[owner, 0], 1)
    columns = within - rows * sides[owner, 0]
    return owner, columns + low[owner, 0], rows + low[owner, 1]


def _alphas(ellipses: Ellipses, alpha: Float64, owner: Int64, points: tuple[Float64, Float64]) -> Float32:
    """Opacity of each Gaussian `owner` (P,) at `points`, (P,) each."""
    half = 0.5 / (ellipses.a * ellipses.c - ellipses.b**2)
    a, b, c = ((k * half).astype(np.float32)[owner] for k in (ellipses.c, 2 * ellipses.b, ellipses.a))
    u, v = ((p - ellipses.middle[owner, i]).astype(np.float32) for i, p in enumerate(points))
    found = alpha.astype(np.float32)[owner] * np.exp(-(a * u * u - b * u * v + c * v * v))
    found[~(found >= LEAST_ALPHA)] = 0.0
    return np.minimum(found, np.float32(MOST_ALPHA), out=found)


def _light(ray: Int64, alphas: Float32) -> Float32:
    """The share of light (P,) that passes what lies before; pairs sorted by `ray`, front to back."""
    depth = -np.log1p(-alphas.astype(np.float64))
    before = np.cumsum(depth) - depth
    starts = np.concatenate([[0], np.flatnonzero(np.diff(ray)) + 1])
    lengths = np.diff(np.concatenate([starts, [len(ray)]]))
    before -= np.repeat(before[starts], lengths)
    light: Float32 = np.exp(-before).astype(np.float32)
    return light


def _of_image(splats: Splats, camera: ViewCamera, near: float, offset: Float64) -> tuple[Float64, ...]:
    """Of one image: what each Gaussian adds, squares, squares without what lies before, rays; (N,) each."""
    count = len(splats.alpha)
    ellipses = project(splats, camera, near)
    order = np.argsort(ellipses.depth, kind="stable")
    spacing = max(camera.width, camera.height) / _RAYS
    shape = np.maximum(np.array([camera.width, camera.height]) // spacing, 1).astype(np.int64)
    first = np.floor(offset * spacing) + 0.5
    owner, columns, rows = _pairs(ellipses, ellipses.reach(splats.alpha), (first, spacing, shape))
    alphas = _alphas(ellipses, splats.alpha, owner, (first[0] + columns * spacing, first[1] + rows * spacing))
    hit = np.flatnonzero(alphas)
    owner, alphas = owner[hit], alphas[hit]
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    ray = rows[hit] * shape[0] + columns[hit]
    pairs = np.argsort(ray * count + rank[owner])
    owner, alphas = owner[pairs], alphas[pairs]
    light = _light(ray[pairs], alphas)
    pixels = spacing * spacing
    added = alphas * light
    return (
        np.bincount(owner, added, count) * pixels,
        np.bincount(owner, added * added, count) * pixels,
        np.bincount(owner, alphas * alphas, count) * pixels,
        np.bincount(owner, minlength=count).astype(np.float64),
    )


def weights_of(splats: Splats, cameras: Iterable[ViewCamera], near: float, seed: int = 0) -> Weights:
    """Blending weights of Gaussians over the images of `cameras`.

    `near`: scene units; rays lie elsewhere for another `seed`.
    """
    random = np.random.default_rng(seed)
    views = [(camera, random.random(2)) for camera in cameras]
    count = len(splats.alpha)
    largest, squared, uncovered, rays, expected = (np.zeros(count) for _ in range(5))
    with ThreadPoolExecutor(2) as beside:
        # scales of +-80 leave the range of floats: these Gaussians are seen nowhere
        def look(view: tuple[ViewCamera, Float64]) -> tuple[tuple[Float64, ...], Float64]:
            with np.errstate(all="ignore"):
                return _of_image(splats, view[0], near, view[1]), _uncovered(splats, view[0], near)

        for (added, squares, alone, hits), area in beside.map(look, views):
            np.maximum(largest, added, out=largest)
            squared += squares
            uncovered += alone
            rays += hits
            expected += area
    light = np.divide(squared, uncovered, out=np.zeros(count), where=uncovered > 0.0)
    trust = rays / (rays + _TRUSTED_RAYS)
    squared = trust * squared + (1.0 - trust) * light * np.nan_to_num(expected)
    return Weights(largest, squared / max(len(views), 1))


def _uncovered(splats: Splats, camera: ViewCamera, near: float) -> Float64:
    """The sum of squares (N,) that each Gaussian would add to an image if nothing lay before it, about."""
    ellipses = project(splats, camera, near)
    inside = ellipses.is_before & (ellipses.middle > 0.0).all(axis=1)
    inside &= (ellipses.middle < np.array([camera.width, camera.height])).all(axis=1)
    area = np.pi * np.sqrt(np.maximum(ellipses.a * ellipses.c - ellipses.b**2, 0.0))
    most = float(camera.width * camera.height)
    return np.where(inside, splats.alpha**2 * np.minimum(area, most), 0.0)
