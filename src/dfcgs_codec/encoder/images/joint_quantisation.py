"""Errors of one attribute that another one makes up for, as far as it is quantised later.

Where a Gaussian's axes came out too long, its image is too large; with a little less opacity the error is
least. The opacity costs the same bits either way.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.encoder.images.splats import alpha_of
from dfcgs_codec.transform.companding import compress, expand

#: how much less opaque, in logarithms, a Gaussian is to be that has become larger, in logarithms of axes: one
#: half would suit one that is alone
_ALPHA_PER_SCALE = 0.35
#: what is more opaque counts as this, and logits change by no more
_MOST_ALPHA, _MOST_SHIFT = 0.95, 1.0


def opacities_beside(decoded: Int64, planes: Mapping[Attribute, Int64], units: UnitExponents) -> Int64:
    """Companded opacities (N, 1) for Gaussians whose scales (N, 3) are not quite those of `planes`.

    One that has become larger has become less opaque: of all changes of alpha this leaves the least error,
    for the profiles of both errors overlap.
    """
    scales = planes[Attribute.SCALE]
    seen = np.argsort(-scales, axis=1, kind="stable")[:, :2]
    larger = np.take_along_axis(decoded - scales, seen, axis=1).sum(axis=1) * 2.0**units.scale
    logits = expand(planes[Attribute.OPACITY][:, 0], units.opacity) * 2.0**units.opacity
    # alpha changes by alpha (1 - alpha) a logit
    shift = -_ALPHA_PER_SCALE * larger / (1.0 - np.minimum(alpha_of(logits), _MOST_ALPHA))
    logits += np.clip(shift, -_MOST_SHIFT, _MOST_SHIFT)
    return compress(np.rint(logits * 2.0**-units.opacity).astype(np.int64), units.opacity)[:, None]
