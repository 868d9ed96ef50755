"""Who shows from where viewers stand: Gaussians that are left out, and cover classes of the others.

An encoder's choice (spec section 9.6); floats are welcome here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Bool, Float64, Int64
from dfcgs_codec.encoder.images.patches import PATCHES, Patch, patches_of_views
from dfcgs_codec.encoder.images.seen import largest_weights
from dfcgs_codec.encoder.images.sensitivity import squared
from dfcgs_codec.encoder.images.splats import Splats, extent
from dfcgs_codec.encoder.matching.identity import is_tracked
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.region import positions_between

#: cameras of the region, and of these every third is not looked from, but judges what is left out
_CAMERAS = 36
_JUDGES = 3
#: images are taken to be no larger, in pixels along the longer side
_MOST_PIXELS = 1600
#: renderers draw nothing nearer, scene units; nor do we what is nearer than this share of the scene
_NEAR, _NEAR_SHARE = 0.01, 1e-3
#: in later frames of a run one of so many cameras is looked from
_LATER = 4
#: cover class of what shows nowhere and is kept all the same: steps that are eight times as coarse
_UNSEEN_COVER = 6
#: halvings of the range in which the least weight is looked for
_HALVINGS = 8


@dataclass(frozen=True)
class Seen:
    """What is coded of a frame: its `rows`, ascending, None: all, and their `cover` classes, None: all 0."""

    rows: Int64 | None
    cover: Int64 | None = None
    num_left_out: int = 0

    def of(self, cloud: GaussianCloud) -> GaussianCloud:
        """Of a frame of the input what is coded."""
        return cloud if self.rows is None else cloud.take(self.rows)


ALL = Seen(None)


@dataclass(frozen=True)
class Region:
    """Where viewers stand: `cameras` to look from, others to judge by; what is less than `near` scene units
    before them is not drawn. Who adds less than `least` pixels to all images is left out, which makes about
    the mean squared `error`, or kept in coarse steps if `keeps_unseen`. `seed`: where rays lie."""

    cameras: Sequence[ViewCamera]
    judges: Sequence[ViewCamera]
    near: float
    least: float = 0.0
    error: float = 0.0
    keeps_unseen: bool = False
    seed: int = 0

    @staticmethod
    def of(views: Views, margin: float, positions: Float64, keeps_unseen: bool) -> Region:
        """Among `views` and as far around as `margin` says; `positions` (N, 3) of the scene."""
        size = extent(positions)
        found = positions_between(views, _CAMERAS, margin=margin, scene_size=size)
        found = [camera.resized(_MOST_PIXELS) for camera in found]
        judges = found[_JUDGES - 1 :: _JUDGES] or found
        cameras = [camera for camera in found if camera not in judges] or found
        return Region(cameras, judges, min(_NEAR, _NEAR_SHARE * size), keeps_unseen=keeps_unseen)

    def weights(self, splats: Splats) -> Float64:
        """What each Gaussian adds to the images of the cameras."""
        return largest_weights(splats, self.cameras, self.near, self.seed)

    def later(self, index: int) -> Region:
        """For later frames of a run: some of the cameras, others from frame to frame."""
        return replace(self, cameras=self.cameras[index % _LATER :: _LATER], seed=index)

    def leaving_out(self, splats: Splats, weights: Float64, error: float) -> Region:
        """Without Gaussians that together make a mean squared error of `error` at most, seen in one frame."""
        patches = self.patches(splats)
        least = least_weight(splats, weights, patches, error)
        left_out = error_without(splats, ~(weights > least), patches)
        return replace(self, least=least, error=left_out)

    def patches(self, splats: Splats, part: int = 0, parts: int = 1) -> list[Patch]:
        """Patches of the judges' images, or one part of them."""
        judges = self.judges[part::parts] or self.judges
        return patches_of_views(splats, judges, self.near, -(-PATCHES // parts))

    def seen(self, weights: Float64) -> Seen:
        """What is coded of a frame of such weights."""
        shows = weights > 0.0 if self.least <= 0.0 else weights >= self.least
        if shows.all() or not shows.any():
            return ALL
        if self.keeps_unseen:
            return Seen(None, np.where(shows, 0, _UNSEEN_COVER))
        rows = np.flatnonzero(shows)
        return Seen(rows, None, len(shows) - len(rows))


def error_without(splats: Splats, is_out: Bool, patches: Sequence[Patch]) -> float:
    """Mean squared error of the patches' pixels without the Gaussians `is_out` (N,)."""
    errors = []
    for patch in patches:
        out = is_out[patch.rows]
        if not out.any():
            errors.append(0.0)
            continue
        drawing = patch.draw(splats.take(patch.rows))
        image = drawing.image()
        drawing.alphas[out] = 0.0
        errors.append(squared(drawing.image(), image))
    return float(np.mean(errors)) if errors else 0.0


def least_weight(splats: Splats, weights: Float64, patches: Sequence[Patch], error: float) -> float:
    """The largest weight below which Gaussians can be left out for a mean squared error of `error`."""
    positive = weights[weights > 0.0]
    if not len(positive):
        return 0.0
    low, high = np.log(float(positive.min())), np.log(float(positive.max()))
    if error_without(splats, weights <= 0.0, patches) > error:
        return 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fits = error_without(splats, weights < np.exp(middle), patches) <= error
        low, high = (middle, high) if fits else (low, middle)
    return float(np.exp(low))


class Shown:
    """What is coded of each frame: as planned for its run, or as it is seen itself."""

    def __init__(
        self, source: FrameSource, region: Region | None, anchors: list[int], seen: Mapping[int, Seen]
    ) -> None:
        self._source, self._region, self._anchors, self._seen = source, region, anchors, seen
        self._start: tuple[int, GaussianCloud] | None = None

    def of(self, index: int, cloud: GaussianCloud) -> Seen:
        """What is coded of frame `index`, which is `cloud`."""
        if self._region is None or not cloud.num_gaussians:
            return ALL
        first = self._anchors[index]
        if first in self._seen and (index == first or is_tracked(self._first(first), cloud)):
            return self._seen[first]
        splats = Splats.of(cloud)
        return self._region.seen(self._region.weights(splats))

    def _first(self, index: int) -> GaussianCloud:
        start = self._start
        if start is None or start[0] != index:
            # frames are read in a thread beside the coding: what is returned is what was asked for
            start = self._start = index, self._source.read(index)[0]
        return start[1]
