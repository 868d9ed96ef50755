"""Companded values: compressed where they hardly show (spec sections 8.3, 9.7).

Piecewise linear, with slopes that are powers of two: shifts, no exp. Opacity: alpha changes by
alpha (1 - alpha) per unit of logit, 0.25 at 0, 0.002 at 6; beyond each knot a unit of the companded grid is
worth twice as much logit as before, so that a step is worth about the same alpha everywhere. Thin axes: the
thinner a third axis is beside the second, the less it shows how thin.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64

#: |logit| in sixteenths at which the slope doubles; alpha (1 - alpha) halves from one to the next
KNOTS = (28, 42, 54, 66, 77, 88, 99)
_KNOT_EXPONENT = -4
#: largest change of alpha per unit (real, not grid) of companded logit
ALPHA_PER_UNIT = 0.262
#: sixteenths of a unit of natural logarithm to an octave, nearly, of the ratio of axes
THIN_OCTAVE = 11


def _companded_knots(knots: list[int]) -> list[int]:
    """Companded values of `knots`, the first of which is 0; the slope halves at each of the others."""
    companded = [0]
    for index in range(1, len(knots)):
        companded.append(companded[-1] + ((knots[index] - knots[index - 1]) >> (index - 1)))
    return companded


def _compress(values: Int64, knots: list[int]) -> Int64:
    magnitude = np.abs(values)
    zone = np.searchsorted(np.array(knots[1:]), magnitude, side="right")
    start, base = np.array(knots)[zone], np.array(_companded_knots(knots))[zone]
    half = (1 << zone) >> 1
    result: Int64 = np.sign(values) * (base + ((magnitude - start + half) >> zone))
    return result


def _expand(companded: Int64, knots: list[int]) -> Int64:
    """Inverse of `_compress` up to its rounding."""
    bases = _companded_knots(knots)
    magnitude = np.abs(companded)
    zone = np.searchsorted(np.array(bases[1:]), magnitude, side="right")
    start, base = np.array(knots)[zone], np.array(bases)[zone]
    result: Int64 = np.sign(companded) * (start + ((magnitude - base) << zone))
    return result


def _logit_knots(exponent: int) -> list[int]:
    return [0] + [knot << (_KNOT_EXPONENT - exponent) for knot in KNOTS]


def compress(logit: Int64, exponent: int) -> Int64:
    """Companded integers of logit integers, both in units of 2**exponent."""
    return _compress(logit, _logit_knots(exponent))


def expand(companded_logit: Int64, exponent: int) -> Int64:
    """Logit integers of companded integers; inverse of `compress` up to its rounding."""
    return _expand(companded_logit, _logit_knots(exponent))


def _thin_knots(exponent: int, octaves: int) -> list[int]:
    return [(THIN_OCTAVE << (_KNOT_EXPONENT - exponent)) * index for index in range(octaves + 1)]


def compress_thinness(logs: Int64, exponent: int, octaves: int) -> Int64:
    """Companded logarithms of the ratio of two axes, in units of 2**exponent: coarser after each octave."""
    return _compress(logs, _thin_knots(exponent, octaves))


def expand_thinness(companded: Int64, exponent: int, octaves: int) -> Int64:
    """Inverse of `compress_thinness` up to its rounding."""
    return _expand(companded, _thin_knots(exponent, octaves))


def thin_octaves(logs: Int64, exponent: int, octaves: int) -> Int64:
    """Octaves, 0 to `octaves`, by which a step of companded logarithms is worth more there."""
    zones: Int64 = np.clip(np.abs(logs) // (THIN_OCTAVE << (_KNOT_EXPONENT - exponent)), 0, octaves)
    return zones
