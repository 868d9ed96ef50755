"""The 3D filter of mip-splatting, put into scale and opacity as its renderer does at each frame."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import AnyArray

#: alpha stays below 1, so that its logit is finite
_MOST = 1 - 1e-7


def bake_filter(scales: AnyArray, opacities: AnyArray, widths: AnyArray) -> tuple[AnyArray, AnyArray]:
    """New log-scales (N, 3) and logits (N, 1) with a filter of standard deviation `widths` (N, 1).

    The variances add up; alpha is scaled by the square root of the ratio of the products of variances, so
    that what a Gaussian hides stays the same. What is not finite stays so, for `check_values` to find.
    """
    with np.errstate(all="ignore"):
        log_variance = 2 * scales.astype(np.float64)
        widened = np.logaddexp(log_variance, 2 * np.log(np.abs(widths.astype(np.float64))))
        log_ratio = 0.5 * (log_variance - widened).sum(axis=1, keepdims=True)
        logits = opacities.astype(np.float64)
        log_alpha = np.minimum(-np.logaddexp(0, -logits) + log_ratio, np.log(_MOST))
        shrunk = log_alpha - np.log(-np.expm1(log_alpha))
        # where the filter does nothing the logit is the one of the file, beyond what alpha can tell
        baked = np.where(log_ratio == 0, logits, shrunk)
    return (0.5 * widened).astype(scales.dtype), baked.astype(opacities.dtype)
