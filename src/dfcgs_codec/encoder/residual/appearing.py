"""Who appears in a GoF: its I-frame chose coarse steps for what did not show yet, and that stays.

P-frames code what changes. Where a Gaussian only becomes visible, its colour and shape do not change, and
keep the errors that were invisible in the I-frame. So the encoder remembers at which step each colour was
coded, and begins a GoF anew where these have fallen behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.frame.gof_state import GofState

#: squared errors of colours as a frame shows them, to those of an I-frame in its place, at most: 1 dB
_MOST_BEHIND = 10.0**0.1
#: weights are in sixteenths of octaves
_PER_OCTAVE = 16.0


def differing_rows(now: Int64, before: Int64) -> Bool:
    """Which rows (N,) of planes (N, C) differ."""
    if now is before:
        return np.zeros(len(now), np.bool_)
    return np.asarray((now != before).any(axis=1))


@dataclass(frozen=True)
class ColourSteps:
    """Steps (N,), in grid units and GoF order, at which the colour of each Gaussian was coded last."""

    steps: Int64

    def after(self, kept: Int64, changed: Bool, fresh: Int64, source: Int64 | None) -> ColourSteps:
        """After a P-frame that codes colours of `changed` of the rows `kept`.

        `fresh`: steps as they are chosen now; `source`: which row of survivors, then births, stands where.
        """
        count = len(kept)
        source = np.arange(count) if source is None else source
        # Gaussians that come are coded anew, as those whose colours change
        is_new = source >= count
        is_new[~is_new] = changed[source[~is_new]]
        steps = self.steps[kept][np.minimum(source, count - 1)]
        return ColourSteps(np.where(is_new, fresh, steps))

    def are_behind(self, state: GofState, fresh: Int64) -> bool:
        """Whether the frame that left `state` would be clearly better as an I-frame."""
        weights = state.visibility.weights(Attribute.SH_DC).astype(np.float64)
        shown = np.exp2((weights - weights.max()) / _PER_OCTAVE)
        had, has = shown @ self.steps.astype(np.float64) ** 2, shown @ fresh.astype(np.float64) ** 2
        return bool(had > _MOST_BEHIND * has)
