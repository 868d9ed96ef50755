"""How much quantisation of each attribute shows in images: seen in small patches, without cameras.

A patch is a few pixels in parallel projection, looked at from one of many directions all around, of what lies
before and behind a Gaussian that light reaches. Training makes Gaussians a few pixels wide in the images that
it has, and as many as these have details. So each Gaussian is as likely to be looked at, whatever its size,
and pixels are as wide as the Gaussians there: a room does not drown what stands in it. An encoder's choice;
floats are welcome here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.splats import Splats, alpha_of, deviations, extent, harmonics
from dfcgs_codec.gaussians import GaussianCloud

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]

_PATCHES = 64
#: pixels along a side of a patch, and from one that is looked at to the next
_SIDE = 8
_STRIDE = 2
#: pixels are as wide as the median of so many Gaussians nearby, but the scene is at least, and at most, so
#: many pixels wide; Gaussians are blurred by this variance, as renderers do
_NEARBY = 64
_FEWEST_PIXELS, _MOST_PIXELS = 400.0, 20_000.0
_BLUR = 0.3
#: what is looked at lies so far before and behind, in pixels
_REACH = 80.0
#: Gaussians end at so many standard deviations
_SIGMAS = 3.0
_MOST_ALPHA = 0.99
#: axes of more pixels are as flat as can be, and float32 holds their squares
_LONGEST = 1e3
#: a patch has no more Gaussians: those that show most
_MOST_GAUSSIANS = 2000
#: of those who swap places in depth there are too few in a few pixels: they are counted where so many times
#: as many do
_SWAPS = 16.0
_GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)


@dataclass(frozen=True)
class ImageError:
    """Mean squared error of pixels that the steps of an attribute make.

    `smooth` grows with the square of the steps. `swaps` is of Gaussians that swap places in depth: each
    changes the image at once, so it grows with their number, as the steps do.
    """

    smooth: float
    swaps: float = 0.0

    def at(self, octaves: float) -> float:
        """All of it, with steps coarser by so many octaves."""
        return self.smooth * float(4.0**octaves) + self.swaps * float(2.0**octaves)

    def scaled(self, by: float) -> ImageError:
        """Both parts times `by`."""
        return ImageError(self.smooth * by, self.swaps * by)

    def __add__(self, other: ImageError) -> ImageError:
        return ImageError(self.smooth + other.smooth, self.swaps + other.swaps)


@dataclass(frozen=True)
class _Patch:
    """Pixels about `middle`; `frame` (3, 3) has the image's two axes and the line of sight as rows."""

    middle: Float64
    frame: Float64
    pixel: float

    def alphas(self, splats: Splats) -> tuple[Float32, Float64]:
        """Opacity of each Gaussian at each pixel, (rows, pixels), and how far away it is, (rows,)."""
        local = (splats.positions - self.middle) @ self.frame.T
        spread = np.einsum("ij,njk->nik", self.frame[:2], splats.axes)
        spread *= splats.deviations[:, None] / self.pixel
        np.clip(spread, -_LONGEST, _LONGEST, out=spread)
        a = (spread[:, 0] ** 2).sum(axis=1) + _BLUR
        b = (spread[:, 0] * spread[:, 1]).sum(axis=1)
        c = (spread[:, 1] ** 2).sum(axis=1) + _BLUR
        half = 0.5 / (a * c - b * b)
        a, b, c = ((k * half)[:, None].astype(np.float32) for k in (a, b, c))
        place = (np.arange(_SIDE) - (_SIDE - 1) / 2) * _STRIDE
        u = (place - local[:, :1] / self.pixel).astype(np.float32)
        v = (place - local[:, 1:2] / self.pixel).astype(np.float32)
        power = (c * u * u)[:, :, None] + (a * v * v)[:, None, :]
        power -= (2 * b * u)[:, :, None] * v[:, None, :]
        alpha = np.exp(-power, out=power).reshape(len(local), -1)
        alpha *= splats.alpha[:, None].astype(np.float32)
        return np.minimum(alpha, np.float32(_MOST_ALPHA), out=alpha), local[:, 2]

    def shades(self, colours: Float64) -> Float32:
        """Colours (rows, 3) as they are seen from there."""
        (basis,) = harmonics(self.frame[2:], colours.shape[2])
        shades: Float32 = np.maximum(colours @ basis + 0.5, 0.0).astype(np.float32)
        return shades


def _weights(alphas: Float32, order: Int64) -> Float32:
    """What Gaussians add to pixels, front to back: rows of `alphas` (rows, pixels) in that order."""
    weights = alphas[order]
    weights[1:] *= np.cumprod(1 - weights[:-1], axis=0)
    return weights


def _squared(difference: Float32) -> float:
    return float((difference.astype(np.float64) ** 2).mean())


def _directions() -> Float64:
    """Unit vectors (_PATCHES, 3), spread evenly."""
    height = 1.0 - (2.0 * np.arange(_PATCHES) + 1.0) / _PATCHES
    turn, radius = _GOLDEN_ANGLE * np.arange(_PATCHES), np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)


def _patches(cloud: GaussianCloud, light: Float64) -> Iterator[tuple[_Patch, Int64]]:
    """Patches, and which Gaussians are in each; none where nothing can be seen."""
    positions = cloud.positions.astype(np.float64)
    size = extent(positions)
    if not 0.0 < size < np.inf:
        return
    _, middle, long = np.sort(deviations(cloud.scales), axis=1).T
    seen = alpha_of(cloud.opacities) * light**2
    seen_before = np.cumsum(seen)
    if not 0.0 < seen_before[-1] < np.inf:
        return
    drawn = np.random.default_rng(0).random(_PATCHES) * seen_before[-1]
    targets = np.minimum(np.searchsorted(seen_before, drawn, side="right"), len(seen) - 1)
    pixels = _pixels(positions, np.sqrt(middle * long), targets)
    pixels = np.clip(pixels, size / _MOST_PIXELS, size / _FEWEST_PIXELS)
    for target, direction, pixel in zip(targets.tolist(), _directions(), pixels.tolist(), strict=True):
        across = np.cross(direction, (0.31, 0.57, 0.76))
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(direction, across), direction])
        patch = _Patch(positions[target], frame, pixel)
        half = _SIDE * _STRIDE / 2 * pixel
        aside = np.abs(positions @ frame[0] - patch.middle @ frame[0])
        rows = np.flatnonzero(aside < _SIGMAS * long + half)
        local = np.abs((positions[rows] - patch.middle) @ frame.T)
        rows = rows[(local[:, 1] < _SIGMAS * long[rows] + half) & (local[:, 2] < _REACH * pixel)]
        if len(rows) > _MOST_GAUSSIANS:
            shown = seen[rows] * np.minimum(middle[rows] * long[rows], size**2)
            rows = np.sort(rows[np.argsort(-shown, kind="stable")[:_MOST_GAUSSIANS]])
        yield patch, rows


def _pixels(positions: Float64, widths: Float64, targets: Int64) -> Float64:
    """How wide pixels are about each target, scene units: as Gaussians nearby, median of `widths` (N,)."""
    tree = cKDTree(positions, balanced_tree=False, compact_nodes=False)
    nearby = tree.query(positions[targets], k=range(1, min(_NEARBY, len(positions)) + 1))[1]
    medians: Float64 = np.median(widths[nearby], axis=1)
    return medians


def image_errors(
    cloud: GaussianCloud, light: Float64, draw: Callable[[Int64], tuple[Splats, Mapping[Attribute, Splats]]]
) -> dict[Attribute, ImageError]:
    """Errors of pixels, by attribute; none where nothing can be seen, or numbers do not suffice.

    `light` (N,): the share of light that reaches each Gaussian. `draw` gives some of the Gaussians as they
    are, and by attribute as they are with that one quantised.
    """

    # scales of +-80 and scenes of 1e-30 units leave the range of floats; such looks say nothing
    @np.errstate(all="ignore")
    def of_patch(where: tuple[_Patch, Int64]) -> dict[Attribute, ImageError]:
        patch, rows = where
        splats, changed = draw(rows)
        alphas, depth = patch.alphas(splats)
        order = np.argsort(depth, kind="stable")
        weights, shades = _weights(alphas, order), patch.shades(splats.colours)
        image = weights.T @ shades[order]
        errors = {}
        for attribute, there in changed.items():
            if attribute >= Attribute.SH_DC:
                difference = weights.T @ (patch.shades(there.colours) - shades)[order]
                errors[attribute] = ImageError(_squared(difference))
                continue
            moved, depth_there = patch.alphas(there)
            errors[attribute] = ImageError(_squared(_weights(moved, order).T @ shades[order] - image))
            if attribute == Attribute.POSITION:
                swapped = np.argsort(depth + _SWAPS * (depth_there - depth), kind="stable")
                swaps = _squared(_weights(alphas, swapped).T @ shades[swapped] - image) / _SWAPS
                errors[attribute] += ImageError(0.0, swaps)
        return errors

    total: dict[Attribute, ImageError] = {}
    with ThreadPoolExecutor(2) as beside:
        # summed in one order, whoever is first
        for errors in beside.map(of_patch, _patches(cloud, light)):
            for attribute, error in errors.items():
                total[attribute] = total.get(attribute, ImageError(0.0)) + error
    if not all(np.isfinite((error.smooth, error.swaps)).all() for error in total.values()):
        return {}
    return {attribute: error.scaled(1.0 / _PATCHES) for attribute, error in total.items()}
