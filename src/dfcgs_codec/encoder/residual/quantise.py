"""From target states to symbols: quantisation, ordering, block classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.array_types import Bool, Float64, Int64
from dfcgs_codec.bitstream.constants import MAX_SORT_BITS, Attribute
from dfcgs_codec.bitstream.frame_headers import SortGrid
from dfcgs_codec.codec.residual.classes import AttributeActivity, InterSymbols, nonzero_rows
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.encoder.plan.position_grid import far_ones
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.block_classes import classify_blocks
from dfcgs_codec.transform.companding import compress
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from dfcgs_codec.transform.pieces import pieces
from dfcgs_codec.transform.rotation import ONE, STEREO_ONE, multiply, to_stereo

Planes = dict[Attribute, Int64]


#: errors that a coarser step of an I-frame left, in such steps, are not worth mending
SLACK = 0.6
#: logit of the least opacity that is drawn
FAINTEST = -4.5
#: with more significant Gaussians than this, all are coded, and their nearest neighbours help
_ALL_DENSE_SHARE = 0.85
#: a unit quaternion times these is its inverse
_CONJUGATE = np.array([1, -1, -1, -1])


@dataclass(frozen=True)
class ZeroBin:
    """Residuals below `threshold` steps are zero; 0.5 is no dead zone."""

    threshold: float

    def quantise(self, residual: Int64, step: Int64 | int) -> Int64:
        """Symbols of grid residuals: to nearest outside the zero bin, halves towards zero.

        `step`: one, or one a residual.
        """
        magnitude, steps = np.abs(residual), np.asarray(step, np.int64)
        symbols = (2 * magnitude + steps - 1) // (2 * steps)
        if self.threshold > 0.5:
            symbols[magnitude < steps * self.threshold] = 0
        signed: Int64 = np.sign(residual) * symbols
        return signed

    def quantise_real(self, residual: Float64) -> Int64:
        """Symbols of residuals in steps."""
        magnitude = np.abs(residual)
        symbols = np.ceil(magnitude - 0.5)
        if self.threshold > 0.5:
            symbols[magnitude < self.threshold] = 0
        return (np.sign(residual) * symbols).astype(np.int64)


def plan_grid(indices: Int64, max_bits: int = MAX_SORT_BITS) -> SortGrid:
    """Cube and resolution for position `indices` (N, 3).

    All of the scene if it fits in `max_bits` bits per axis, but for one or two Gaussians far out, which
    change nothing for the others; else the middle 98 %, four times as wide, far outliers being clipped, with
    as many low bits left raw as that needs.
    """
    near = indices[~far_ones(indices)]
    low, high = near.min(axis=0), near.max(axis=0)
    bits = int((high - low).max()).bit_length()
    if bits <= max_bits:
        x, y, z = low.tolist()
        return SortGrid(0, bits, (x, y, z), len(near) < len(indices))
    inner = np.quantile(indices, [0.01, 0.99], axis=0, method="nearest").astype(np.int64)
    middle = (inner[0] + inner[1]) // 2
    half = max(1, 2 * int((inner[1] - inner[0]).max()))
    shift = max(0, (2 * half).bit_length() - max_bits)
    bits = min(max_bits, (2 * half >> shift).bit_length())
    x, y, z = ((middle - half) >> shift).tolist()
    return SortGrid(shift, bits, (x, y, z), True)


def order_of(indices: Int64, grid: SortGrid) -> Int64:
    """Canonical order of position `indices` (N, 3)."""
    cells = np.clip((indices >> grid.shift) - np.array(grid.origin), 0, (1 << grid.bits) - 1)
    return canonical_order(morton_keys(cells), indices)


def relative_rotation(target: Int64, reference: Int64, step: int) -> Float64:
    """Stereographic vectors, in steps, of the turns about the Gaussians' own axes."""
    vectors = np.empty((len(target), 3))
    for part in pieces(len(target)):
        turn = multiply(reference[part] * _CONJUGATE, target[part])
        np.multiply(to_stereo(turn / ONE), STEREO_ONE / step, out=vectors[part])
    return vectors


@dataclass(frozen=True)
class ResidualQuantiser:
    """How a P-frame's residuals become symbols.

    `multipliers`: by what 256ths the step of each Gaussian is coarser, (N, 1), where they are not one;
    `slack`: steps (N, 1), or (N, columns), of which errors of up to `slack_share` are left as they are.
    """

    quantisation: Quantisation
    zero_bin: ZeroBin
    multipliers: Mapping[Attribute, Int64] = field(default_factory=dict)
    slack: Mapping[Attribute, Int64] = field(default_factory=dict)
    slack_share: float = SLACK

    def symbols(self, attribute: Attribute, rows: Int64, target: Int64, reference: Int64) -> Int64:
        """Symbols (N, C) of the Gaussians `rows`, ascending, 0 for the rest."""
        if len(rows) == len(target):
            return self._symbols(attribute, slice(None), target, reference)
        found = self._symbols(attribute, rows, target.take(rows, axis=0), reference.take(rows, axis=0))
        symbols = np.zeros((len(target), found.shape[1]), np.int64)
        symbols[rows] = found
        return symbols

    def _symbols(self, attribute: Attribute, rows: Int64 | slice, target: Int64, reference: Int64) -> Int64:
        """Those (n, C) of `rows` alone, whose `target` and `reference` are given."""
        step = self.quantisation.steps[attribute]
        zero_bin = ZeroBin(0.5) if attribute in self.quantisation.bounded else self.zero_bin
        multipliers = self.multipliers.get(attribute)
        if attribute != Attribute.ROTATION and multipliers is None and attribute not in self.slack:
            return zero_bin.quantise(target - reference, step)
        if attribute == Attribute.ROTATION:
            residual = relative_rotation(target, reference, step)
        else:
            residual = (target - reference) / step
        if multipliers is not None:
            residual *= 256.0 / multipliers[rows]
        found = zero_bin.quantise_real(residual)
        slack = self.slack.get(attribute)
        if slack is not None:
            real = slack[rows] / step
            if multipliers is not None:
                real *= 256.0 / multipliers[rows]
            found[np.abs(residual) < self.slack_share * real] = 0
        if attribute == Attribute.OPACITY and zero_bin.threshold > 0.5:
            # what is not to be seen must not be left a little visible
            faint = target < faintest(self.quantisation.units.opacity)
            found[faint] = np.floor(residual[faint]).astype(np.int64)
        return found


def moved_rows(attribute: Attribute, reference: FrameState, predicted: FrameState) -> Bool | None:
    """Whether each Gaussian of `predicted` differs from `reference`; None where none does."""
    old, new = reference.planes[attribute], predicted.planes[attribute]
    return None if old is new else nonzero_rows(new.values - old.values)


def inter_symbols(
    target: Planes,
    before: Planes,
    states: tuple[FrameState, FrameState],
    quantiser: ResidualQuantiser,
) -> InterSymbols:
    """Symbols of a P-frame; attributes without any are left out.

    `before` are the target planes of the previous frame, `states` the reference and what motion makes of it:
    what has neither changed nor moved gets no symbols, whatever the distance to the reference.
    """
    reference, predicted = states
    activity = {}
    for attribute, values in target.items():
        moved = moved_rows(attribute, reference, predicted)
        if values is before[attribute] and moved is None:
            continue
        differs = nonzero_rows(values - before[attribute])
        changed = np.flatnonzero(differs if moved is None else differs | moved)
        if not len(changed):
            continue
        symbols = quantiser.symbols(attribute, changed, values, predicted.planes[attribute].wide())
        if symbols.any():
            activity[attribute] = AttributeActivity(symbols, *classify_blocks(symbols))
    return InterSymbols(activity)


def faintest(exponent: int) -> int:
    """The companded opacity, in units of 2**exponent, below which nothing is drawn."""
    return int(compress(np.array([round(FAINTEST * 2.0**-exponent)]), exponent)[0])
