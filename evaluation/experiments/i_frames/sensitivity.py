"""How much each attribute's quantisation shows in the rendered image.

Each attribute alone is rounded to a uniform quantiser (rotations: turned at random as far as their quantiser
would), the first frame of a scene is rendered from three views, and compared with the unchanged frame. Most
errors grow with the square of the step; those of positions with a smaller power, because Gaussians that swap
places in depth change the image at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.plan.quantiser_steps import REFERENCE_STEPS, typical_size
from dfcgs_codec.gaussians import GaussianCloud
from lab.quality import frame_quality, image
from lab.scenes import rotations
from lab.views import ANGLES, FEW, central_box, framing_camera

_BANDS = {Attribute.SH_1: (0, 3), Attribute.SH_2: (3, 8), Attribute.SH_3: (8, 15)}


def _rounded(values: np.ndarray, step: float) -> np.ndarray:
    return (step * np.rint(values / step)).astype(np.float32)


def _turned(cloud: GaussianCloud, step: float) -> GaussianCloud:
    """Turn by the error of a stereographic quantiser: 4 radians per unit near the identity."""
    rng = np.random.default_rng(0)
    turns = rotations.from_vectors(4.0 * step * rng.uniform(-0.5, 0.5, (cloud.num_gaussians, 3)))
    return replace(cloud, rotations=rotations.multiply(cloud.rotations, turns).astype(np.float32))


def quantised(cloud: GaussianCloud, attribute: Attribute, step: float) -> GaussianCloud:
    """`cloud` with one attribute rounded; `step` in the attribute's own unit, positions in scene units."""
    if attribute == Attribute.POSITION:
        return replace(cloud, positions=_rounded(cloud.positions, step))
    if attribute == Attribute.ROTATION:
        return _turned(cloud, step)
    if attribute == Attribute.SCALE:
        return replace(cloud, scales=_rounded(cloud.scales, step))
    if attribute == Attribute.OPACITY:
        return replace(cloud, opacities=_rounded(cloud.opacities, step))
    if attribute == Attribute.SH_DC:
        return replace(cloud, sh_dc=_rounded(cloud.sh_dc, step))
    low, high = _BANDS[attribute]
    rest = cloud.sh_rest.copy()
    rest[:, :, low:high] = _rounded(rest[:, :, low:high], step)
    return replace(cloud, sh_rest=rest)


def error_curves(cloud: GaussianCloud, up: str, octaves: Sequence[float]) -> dict[str, list[float]]:
    """Mean squared errors by attribute, each alone at its reference step times two to the `octaves`.

    Attributes that the cloud does not have are left out.
    """
    views = [framing_camera(central_box(cloud), ANGLES[i], up) for i in FEW]
    sources = [image(cloud, view) for view in views]

    def error(attribute: Attribute, octave: float) -> float:
        unit = typical_size(cloud) if attribute == Attribute.POSITION else 1.0
        changed = quantised(cloud, attribute, 2.0**octave * REFERENCE_STEPS[attribute] * unit)
        return frame_quality(0, sources, changed, views).visible.mse

    return {a.name: [error(a, o) for o in octaves] for a in attributes_of(cloud)}


def attributes_of(cloud: GaussianCloud) -> list[Attribute]:
    """The attributes with a step that a cloud has."""
    bands = {a: high for a, (_, high) in _BANDS.items()}
    return [a for a in REFERENCE_STEPS if cloud.sh_rest.shape[2] >= bands.get(a, 0)]
