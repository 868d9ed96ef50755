"""Patches of images: few pixels, and the Gaussians that show there. What an encoder looks at.

An encoder's choice; floats are welcome here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.images.projection import LEAST_ALPHA, MOST_ALPHA, project
from dfcgs_codec.encoder.images.splats import Splats, extent, harmonics, turned
from dfcgs_codec.views.camera import LARGEST, ViewCamera

#: patches that are looked at
PATCHES = 96
#: pixels along a side of a patch, and from one that is looked at to the next
_SIDE = 8
_STRIDE = 2
#: a patch has no more Gaussians: those that show most
_MOST_GAUSSIANS = 6000
#: what never adds more than this to a pixel does not show there
_LEAST_WEIGHT = 1.0 / 2048.0
#: without cameras, pixels are as wide as the median of so many Gaussians nearby, but the scene is at least,
#: and at most, so many pixels wide
_NEARBY = 64
_FEWEST_PIXELS, _MOST_PIXELS = 400.0, 20_000.0
#: such pixels are as small as the details of the scene: errors are larger by so many dB than in images
NEARBY_BIAS = 0.7
#: then what is looked at lies so far before and behind, in pixels, and the camera so many times as far away
_REACH = 80.0
_AWAY = 50.0
#: no Gaussian is drawn farther out, in deviations
_REACHED = 3.4
_GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)


def in_order(alphas: Float32, order: Int64) -> Float32:
    """What Gaussians of `alphas` (n, pixels) add to pixels, (n, pixels), drawn in that order: of the rows."""
    weights = alphas[order]
    weights[1:] *= np.cumprod(1 - weights[:-1], axis=0)
    return weights


@dataclass(frozen=True)
class Drawing:
    """A patch before it is blended: opacities (n, pixels), shades (n, 3) and depth (n,) of its Gaussians."""

    alphas: Float32
    shades: Float32
    depth: Float64

    def image(self, order: Int64 | None = None) -> Float32:
        """Pixels (pixels, 3) as a display shows them; the order by depth if none is given."""
        order = np.argsort(self.depth, kind="stable") if order is None else order
        image: Float32 = np.clip(in_order(self.alphas, order).T @ self.shades[order], 0.0, 1.0)
        return image


@dataclass(frozen=True)
class Patch:
    """Pixels of a camera's image from `corner` (2,) on, and the `rows` of the Gaussians that show there.

    What is nearer than `near`, in scene units, is not drawn.
    """

    camera: ViewCamera
    corner: Float64
    near: float
    rows: Int64

    def draw(self, splats: Splats) -> Drawing:
        """The Gaussians of the patch."""
        alphas, depth = self.alphas(splats)
        return Drawing(alphas, self._shades(splats), depth)

    def drawn_anew(self, before: Drawing, splats: Splats, changed: Attribute) -> Drawing:
        """The Gaussians of the patch after one attribute `changed`: what it has no part in is as it was."""
        if changed >= Attribute.SH_DC:
            return replace(before, shades=self._shades(splats))
        if changed == Attribute.POSITION:
            return self.draw(splats)
        alphas, depth = self.alphas(splats)
        return Drawing(alphas, before.shades, depth)

    def alphas(self, splats: Splats) -> tuple[Float32, Float64]:
        """Opacity of each Gaussian at each pixel, (n, pixels), and how far away it is, (n,)."""
        ellipses = project(splats, self.camera, self.near)
        half = 0.5 / (ellipses.a * ellipses.c - ellipses.b**2)
        a, b, c = ((k * half)[:, None].astype(np.float32) for k in (ellipses.c, 2 * ellipses.b, ellipses.a))
        place = self.corner[:, None] + np.arange(_SIDE) * _STRIDE + 0.5
        u = (place[0] - ellipses.middle[:, :1]).astype(np.float32)
        v = (place[1] - ellipses.middle[:, 1:]).astype(np.float32)
        power = (a * u * u)[:, :, None] + (c * v * v)[:, None, :]
        power -= (b * u)[:, :, None] * v[:, None, :]
        alphas = np.exp(-power, out=power).reshape(len(u), _SIDE * _SIDE)
        alphas *= np.where(ellipses.is_before, splats.alpha, 0.0)[:, None].astype(np.float32)
        alphas[~(alphas >= LEAST_ALPHA)] = 0.0
        np.minimum(alphas, np.float32(MOST_ALPHA), out=alphas)
        return alphas, ellipses.depth

    def _shades(self, splats: Splats) -> Float32:
        """Colours (n, 3) as they are seen from there."""
        away = splats.positions - self.camera.position
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
        basis = harmonics(away, splats.colours.shape[2])
        shades = np.einsum("nck,nk->nc", splats.colours, basis) + 0.5
        shown: Float32 = np.maximum(shades, 0.0).astype(np.float32)
        return shown


def _showing(splats: Splats, camera: ViewCamera, near: float, corners: Float64) -> Iterator[Patch]:
    """Patches of one image, at `corners` (n, 2)."""
    ellipses = project(splats, camera, near)
    reach = ellipses.reach(splats.alpha)
    low, high = ellipses.middle - reach, ellipses.middle + reach
    for corner in corners:
        end = corner + _SIDE * _STRIDE
        rows = np.flatnonzero((high > corner).all(axis=1) & (low < end).all(axis=1))
        patch = Patch(camera, corner, near, rows)
        alphas, depth = patch.alphas(splats.take(rows))
        order = np.argsort(depth, kind="stable")
        most = in_order(alphas, order).max(axis=1, initial=0.0)
        shown = np.argsort(-most, kind="stable")[:_MOST_GAUSSIANS]
        rows = rows[np.sort(order[shown[most[shown] > _LEAST_WEIGHT]])]
        yield Patch(camera, corner, near, rows)


def patches_of_views(
    splats: Splats, cameras: Sequence[ViewCamera], near: float, count: int = PATCHES
) -> list[Patch]:
    """About `count` patches spread over the images of `cameras`; near: scene units."""
    random = np.random.default_rng(1)
    each = -(-count // len(cameras))
    found: list[Patch] = []
    for camera in cameras:
        sides = np.maximum(np.array([camera.width, camera.height]) - _SIDE * _STRIDE, 1)
        # one in each of as many columns of the image, in random order of rows
        across = (np.arange(each) + random.random(each)) / each
        down = (random.permutation(each) + random.random(each)) / each
        found += _showing(splats, camera, near, np.floor(np.stack([across, down], axis=1) * sides))
    return found


def _direction(index: int, count: int) -> Float64:
    """One of `count` unit vectors (3,) that are spread evenly."""
    height = 1.0 - (2.0 * index + 1.0) / count
    turn, radius = _GOLDEN_ANGLE * index, np.sqrt(1.0 - height**2)
    return np.array([radius * np.cos(turn), radius * np.sin(turn), height])


@dataclass(frozen=True)
class Surroundings:
    """What patches without cameras are chosen from.

    `positions` (N, 3), scene units; `widths` and `longest` (N,), deviations: geometric mean of the two longer
    axes, and the longest; `alpha` (N,); `shapes` gives the Gaussians of some rows, their colours or none.
    """

    positions: Float64
    widths: Float64
    longest: Float64
    alpha: Float64
    shapes: Callable[[Int64], Splats]

    @cached_property
    def _columns(self) -> Float64:
        return np.ascontiguousarray(self.positions.T)

    @staticmethod
    def of(splats: Splats) -> Surroundings:
        """Those of all Gaussians."""
        _, middle, longest = np.sort(splats.deviations, axis=1).T
        return Surroundings(splats.positions, np.sqrt(middle * longest), longest, splats.alpha, splats.take)

    def targets(self, count: int, seed: int) -> Int64:
        """`count` Gaussians, those that show more often than others; none where nothing shows."""
        seen_before = np.cumsum(self.alpha)
        if not 0.0 < seen_before[-1] < np.inf:
            return np.zeros(0, np.int64)
        drawn = np.random.default_rng(seed).random(count) * seen_before[-1]
        found: Int64 = np.searchsorted(seen_before, drawn, side="right")
        return np.minimum(found, len(self.alpha) - 1)

    def pixel(self, target: int) -> float:
        """How wide pixels are about a Gaussian, scene units: as the Gaussians nearby, their median."""
        x, y, z = self._columns - self._columns[:, [target]]
        distances = x * x + y * y + z * z
        nearby = min(_NEARBY, len(distances))
        return float(np.median(self.widths[np.argpartition(distances, nearby - 1)[:nearby]]))

    def patch(self, target: int, direction: Float64, pixel: float) -> Patch:
        """The patch about a Gaussian that is seen in a direction."""
        across = np.cross(direction, (0.31, 0.57, 0.76))
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(direction, across), direction])
        middle, away = self.positions[target], _AWAY * _REACH * pixel
        u, v, depth = np.abs(turned(self._columns - middle[:, None], frame))
        tube = _REACHED * self.longest + _SIDE * _STRIDE * pixel
        near = np.flatnonzero((depth < _REACH * pixel) & (u < tube) & (v < tube))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = frame, -frame @ (middle - away * direction)
        sides, focal = _SIDE * _STRIDE, _AWAY * _REACH
        camera = ViewCamera(sides, sides, focal, focal, sides / 2, sides / 2, pose)
        (found,) = _showing(self.shapes(near), camera, 0.5 * away, np.zeros((1, 2)))
        return Patch(camera, found.corner, found.near, near[found.rows])


def patches_among(scene: Surroundings, count: int, seed: int) -> list[Patch]:
    """Patches without cameras: each looks at a Gaussian closely, from anywhere; none where nothing shows.

    Training makes Gaussians a few pixels wide in the images that it has, and as many as these have details.
    So each Gaussian is as likely to be looked at, whatever its size, and pixels are as wide as the Gaussians
    there: a room does not drown what stands in it, and walls do not hide what stands before them.
    """
    size = extent(scene.positions)
    if not 0.0 < size < np.inf:
        return []
    found = []
    for index, target in enumerate(scene.targets(count, seed).tolist()):
        pixel = float(np.clip(scene.pixel(target), size / _MOST_PIXELS, size / _FEWEST_PIXELS))
        # no camera stands where numbers do not suffice
        if np.abs(scene.positions[target]).max() + _AWAY * _REACH * pixel < LARGEST:
            found.append(scene.patch(target, _direction((index + seed) % count, count), pixel))
    return found


def patches_nearby(splats: Splats, count: int = PATCHES, seed: int = 0) -> list[Patch]:
    """`patches_among` all of some Gaussians."""
    return patches_among(Surroundings.of(splats), count, seed)
