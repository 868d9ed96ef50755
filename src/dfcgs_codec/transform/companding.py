"""Companded opacity: the logit, compressed where alpha hardly changes (spec section 8.3).

alpha changes by alpha (1 - alpha) per unit of logit: 0.25 at 0, 0.002 at 6. Beyond each knot a unit of
the companded grid is worth twice as much logit as before, so that a step is worth about the same
alpha everywhere. Piecewise linear with slopes that are powers of two: shifts, no exp.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Int64 = npt.NDArray[np.int64]

#: |logit| in sixteenths at which the slope doubles; alpha (1 - alpha) halves from one to the next
KNOTS = (28, 42, 54, 66, 77, 88, 99)
_KNOT_EXPONENT = -4
#: largest change of alpha per unit (real, not grid) of companded logit
ALPHA_PER_UNIT = 0.262


def _knots(exponent: int) -> tuple[list[int], list[int]]:
    """Knots in grid units of 2**exponent: of the logit, and of the companded logit."""
    logit = [0] + [knot << (_KNOT_EXPONENT - exponent) for knot in KNOTS]
    companded = [0]
    for index in range(1, len(logit)):
        companded.append(companded[-1] + ((logit[index] - logit[index - 1]) >> (index - 1)))
    return logit, companded


def compress(logit: Int64, exponent: int) -> Int64:
    """Companded integers of logit integers, both in units of 2**exponent."""
    knots, companded = _knots(exponent)
    magnitude = np.abs(logit)
    zone = np.searchsorted(np.array(knots[1:]), magnitude, side="right")
    start, base = np.array(knots)[zone], np.array(companded)[zone]
    half = (1 << zone) >> 1
    result: Int64 = np.sign(logit) * (base + ((magnitude - start + half) >> zone))
    return result


def expand(companded_logit: Int64, exponent: int) -> Int64:
    """Logit integers of companded integers; inverse of `compress` up to its rounding."""
    knots, companded = _knots(exponent)
    magnitude = np.abs(companded_logit)
    zone = np.searchsorted(np.array(companded[1:]), magnitude, side="right")
    start, base = np.array(knots)[zone], np.array(companded)[zone]
    result: Int64 = np.sign(companded_logit) * (start + ((magnitude - base) << zone))
    return result
