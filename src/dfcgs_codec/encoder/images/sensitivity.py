"""How much quantisation of each attribute shows in images: seen in small patches.

An encoder's choice; floats are welcome here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.images.patches import Drawing, Patch
from dfcgs_codec.encoder.images.splats import Splats

#: of those who swap places in depth there are too few in a few pixels: they are counted where so many times
#: as many do
_SWAPS = 16.0


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


def squared(a: Float32, b: Float32) -> float:
    """Mean squared difference."""
    return float(((a - b).astype(np.float64) ** 2).mean())


def _errors_of(
    patch: Patch, splats: Splats, changed: Mapping[Attribute, Splats]
) -> dict[Attribute, ImageError]:
    before = patch.draw(splats)
    order = np.argsort(before.depth, kind="stable")
    image, errors = before.image(order), {}
    for attribute, there in changed.items():
        after = patch.drawn_anew(before, there, attribute)
        still = order if attribute == Attribute.POSITION else None
        errors[attribute] = ImageError(squared(after.image(still), image))
        if attribute == Attribute.POSITION:
            moved = before.depth + _SWAPS * (after.depth - before.depth)
            swapped = Drawing(before.alphas, before.shades, moved)
            errors[attribute] += ImageError(0.0, squared(swapped.image(), image) / _SWAPS)
    return errors


def image_errors(
    patches: Sequence[Patch], draw: Callable[[Int64], tuple[Splats, Mapping[Attribute, Splats]]]
) -> dict[Attribute, ImageError]:
    """Errors of pixels, by attribute; none where nothing can be seen, or numbers do not suffice.

    `draw` gives some of the Gaussians as they are, and by attribute as they are with that one quantised.
    """

    # scales of +-80 and scenes of 1e-30 units leave the range of floats; such looks say nothing
    @np.errstate(all="ignore")
    def of_patch(patch: Patch) -> dict[Attribute, ImageError]:
        return _errors_of(patch, *draw(patch.rows)) if len(patch.rows) else {}

    total: dict[Attribute, ImageError] = {}
    with ThreadPoolExecutor(2) as beside:
        # summed in one order, whoever is first
        for errors in beside.map(of_patch, patches):
            for attribute, error in errors.items():
                total[attribute] = total.get(attribute, ImageError(0.0)) + error
    if not all(np.isfinite((error.smooth, error.swaps)).all() for error in total.values()):
        return {}
    return {attribute: error.scaled(1.0 / len(patches)) for attribute, error in total.items()}
