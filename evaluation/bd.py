"""Bjontegaard deltas between two rate-distortion curves (VCEG-M33), by the `bjontegaard` package.

Curves are lists of (rate, PSNR); rates in any unit, the same for both. Interpolation is piecewise cubic
Hermite, as in JCT-VC's common test conditions since 2013. Where the PSNR ranges of two curves do not overlap
there is no delta, and how much of the ranges overlap is reported beside each.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import bjontegaard as bd
import numpy as np

Curve = Sequence[tuple[float, float]]
#: a delta over less than this (decibel) says nothing
LEAST_OVERLAP = 1.0


@dataclass(frozen=True)
class Delta:
    """Of a tested curve against an anchor.

    bd_rate: percent more bytes at equal PSNR, negative for less. bd_psnr: decibel at equal bytes; None where
    the rates do not overlap. overlap: decibel that both curves reach.
    """

    bd_rate: float
    bd_psnr: float | None
    overlap: float


def rising(curve: Curve) -> list[tuple[float, float]]:
    """The points that no cheaper one equals or beats, by rate: what a user would choose from."""
    kept: list[tuple[float, float]] = []
    for rate, psnr in sorted(curve):
        if not kept or psnr > kept[-1][1]:
            kept.append((rate, psnr))
    return kept


def _overlap(first: Sequence[float], second: Sequence[float]) -> float:
    return min(max(first), max(second)) - max(min(first), min(second))


def bd_delta(anchor: Curve, tested: Curve) -> Delta | None:
    """The deltas of `tested`; None where either curve has one point only or the PSNRs hardly meet."""
    a, t = rising(anchor), rising(tested)
    if len(a) < 2 or len(t) < 2:
        return None
    (rates_a, psnrs_a), (rates_t, psnrs_t) = zip(*a, strict=True), zip(*t, strict=True)
    overlap = _overlap(psnrs_a, psnrs_t)
    if overlap < LEAST_OVERLAP:
        return None
    curves = (rates_a, psnrs_a, rates_t, psnrs_t)
    with warnings.catch_warnings():
        # a small overlap is reported, not warned about
        warnings.simplefilter("ignore")
        rate = bd.bd_rate(*curves, method="pchip", require_matching_points=False, min_overlap=0)
        psnr = None
        if _overlap(np.log(rates_a).tolist(), np.log(rates_t).tolist()) > 0.0:
            psnr = float(bd.bd_psnr(*curves, method="pchip", require_matching_points=False, min_overlap=0))
    return Delta(float(rate), psnr, overlap)


def rate_at(curve: Curve, psnr: float) -> float | None:
    """The rate at which a curve reaches `psnr`, log rate interpolated; None outside of the curve."""
    points = rising(curve)
    psnrs = [p for _, p in points]
    if not points or not psnrs[0] <= psnr <= psnrs[-1]:
        return None
    return float(np.exp(np.interp(psnr, psnrs, [np.log(r) for r, _ in points])))


def psnr_at(curve: Curve, rate: float) -> float | None:
    """The PSNR at a rate, interpolated over the log of the rate; None outside of the curve."""
    points = rising(curve)
    if not points or not points[0][0] <= rate <= points[-1][0]:
        return None
    return float(np.interp(np.log(rate), [np.log(r) for r, _ in points], [p for _, p in points]))
