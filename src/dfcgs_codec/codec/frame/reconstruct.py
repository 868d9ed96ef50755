"""From symbols to state: called by encoder and decoder alike (law 2; spec sections 9 and 8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.codec.residual.classes import InterSymbols, nonzero_rows
from dfcgs_codec.codec.state.planes import FrameState, Plane, scaled
from dfcgs_codec.codec.state.visibility import MULTIPLIER_BITS
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.transform.rotation import from_stereo, multiply, normalise


def _in_range(values: Int64) -> Plane:
    if len(values) and (values.min() < -STATE_LIMIT or values.max() > STATE_LIMIT):
        raise CorruptBitstream("a reconstructed value leaves the range of the state")
    return Plane(values)


def _coarser(changes: Int64, multipliers: Int64 | None) -> Int64:
    """Changes (N, C) times multipliers (N, 1) in 256ths."""
    if multipliers is None:
        return changes
    return (changes * multipliers + (1 << (MULTIPLIER_BITS - 1))) >> MULTIPLIER_BITS


def _turn(reference: Plane, symbols: Int64, step: int, multipliers: Int64 | None) -> Plane:
    """Rotate about each Gaussian's own axes; rows without symbols keep their bits."""
    rows = np.flatnonzero(nonzero_rows(symbols))
    quaternions = reference.wide()
    vectors = _coarser(scaled(symbols[rows], step), None if multipliers is None else multipliers[rows])
    quaternions[rows] = normalise(multiply(quaternions[rows], from_stereo(vectors)))
    return Plane(quaternions)


def reconstruct_inter(
    symbols: InterSymbols,
    steps: dict[Attribute, int],
    reference: FrameState,
    multipliers: Mapping[Attribute, Int64] | None = None,
) -> FrameState:
    """State of a P-frame; planes without symbols are the reference's own, and so is a whole skipped frame.

    `multipliers`: by what 256ths the step of each Gaussian is coarser, (N, 1), where they are not one.
    """
    if not symbols.activity:
        return reference
    planes, coarser = dict(reference.planes), multipliers or {}
    for attribute, activity in symbols.activity.items():
        plane, step = reference.planes[attribute], steps[attribute]
        if attribute == Attribute.ROTATION:
            planes[attribute] = _turn(plane, activity.symbols, step, coarser.get(attribute))
        else:
            changes = _coarser(scaled(activity.symbols, step), coarser.get(attribute))
            planes[attribute] = _in_range(plane.wide() + changes)
    return replace(reference, planes=planes, verbatim=None)
