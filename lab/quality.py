"""Identical-source quality: the decoded and the source Gaussians rendered from the same cameras.

Squared errors are pooled over views and frames. The main figure counts pixels where either image has
alpha > 1/255, so that empty background neither helps nor harms; the full-frame figure stands beside it, and
is the main one of captures, which fill their images.
Colours are clipped to [0, 1] first, as a display does; the background is black.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Float32
from dfcgs_codec.gaussians import GaussianCloud
from lab.render import Camera, render, ssim

#: a pixel counts where either image is less transparent than this
VISIBLE_ALPHA = 1.0 / 255.0


@dataclass(frozen=True)
class Image:
    """colour (H, W, 3) in [0, 1]; alpha (H, W)."""

    colour: Float32
    alpha: Float32


def image(cloud: GaussianCloud, camera: Camera) -> Image:
    """What a display would show."""
    rendering = render(cloud, camera)
    return Image(np.clip(rendering.colour, 0.0, 1.0), rendering.alpha)


def psnr(mean_squared_error: float) -> float | None:
    """Decibel at a peak of 1; None where there is no error at all."""
    return -10.0 * math.log10(mean_squared_error) if mean_squared_error > 0.0 else None


@dataclass
class Pool:
    """Sums of squared errors and the number of values in them."""

    squared: float = 0.0
    count: int = 0

    def add(self, squares: Float32) -> None:
        """Add squared errors of any shape."""
        self.squared += float(squares.sum(dtype=np.float64))
        self.count += squares.size

    @property
    def mse(self) -> float:
        """Mean; 0 where nothing was visible."""
        return self.squared / self.count if self.count else 0.0


@dataclass
class FrameQuality:
    """One frame over all its views; every_pixel: also where both images are empty."""

    index: int
    every_pixel: bool = False
    visible: Pool = field(default_factory=Pool)
    full: Pool = field(default_factory=Pool)
    ssims: list[float] = field(default_factory=list)

    def add(self, source: Image, decoded: Image) -> None:
        """Compare one view."""
        squares = (source.colour - decoded.colour) ** 2
        self.full.add(squares)
        seen = (source.alpha > VISIBLE_ALPHA) | (decoded.alpha > VISIBLE_ALPHA)
        self.visible.add(squares if self.every_pixel else squares[seen])
        self.ssims.append(float(ssim(source.colour, decoded.colour)))


def frame_quality(
    index: int,
    sources: list[Image],
    decoded: GaussianCloud,
    cameras: list[Camera],
    every_pixel: bool = False,
) -> FrameQuality:
    """Compare a decoded frame with the images of its source."""
    return compared(index, sources, [image(decoded, camera) for camera in cameras], every_pixel)


def compared(
    index: int, sources: list[Image], decoded: list[Image], every_pixel: bool = False
) -> FrameQuality:
    """Compare images of a frame with those of its source, view by view."""
    quality = FrameQuality(index, every_pixel)
    for source, seen in zip(sources, decoded, strict=True):
        quality.add(source, seen)
    return quality


def true_quality(true: dict[int, list[Float32]], seen: dict[int, list[Image]]) -> tuple[float | None, float]:
    """PSNR over all pixels, and SSIM, of images by frame against true ones (H, W, 3), view by view."""
    pool, ssims = Pool(), []
    for index, images in true.items():
        for expected, found in zip(images, seen[index], strict=True):
            pool.add((expected - found.colour) ** 2)
            ssims.append(float(ssim(expected, found.colour)))
    return psnr(pool.mse), float(np.mean(ssims))


def summary(frames: Iterable[FrameQuality]) -> dict[str, Any]:
    """Figures of a sequence; a PSNR of None means that the images are equal."""
    rated = list(frames)
    visible = Pool(sum(f.visible.squared for f in rated), sum(f.visible.count for f in rated))
    full = Pool(sum(f.full.squared for f in rated), sum(f.full.count for f in rated))
    worst = max(rated, key=lambda f: f.visible.mse)
    return {
        "mse": visible.mse,
        "psnr": psnr(visible.mse),
        "psnr_full_frame": psnr(full.mse),
        "psnr_worst_frame": psnr(worst.visible.mse),
        "worst_frame": worst.index,
        "ssim": float(np.mean([s for f in rated for s in f.ssims])),
        "psnr_by_frame": {str(f.index): psnr(f.visible.mse) for f in rated},
    }
