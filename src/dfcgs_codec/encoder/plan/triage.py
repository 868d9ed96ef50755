"""What kind of sequence is this: checked, not assumed."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud

#: Gaussians looked at
_SAMPLE = 4096
#: median displacement of equal indices, as part of other pairs' distance, up to which they are the same
_TRACKED_SHARE = 0.25


def is_tracked(first: GaussianCloud, other: GaussianCloud) -> bool:
    """Whether equal indices in both frames name the same Gaussians.

    They do when the counts agree and, a motion common to all taken off, Gaussians of equal index lie nearer
    to each other than those half the sequence apart.
    """
    n = first.num_gaussians
    if other.num_gaussians != n:
        return False
    rows = np.arange(0, n, max(1, n // _SAMPLE))
    partner = np.roll(rows, len(rows) // 2)
    moved = other.positions[rows].astype(np.float64) - first.positions[rows]
    moved -= np.median(moved, axis=0)
    apart = first.positions[rows].astype(np.float64) - first.positions[partner]
    same, others = np.abs(moved).sum(axis=1), np.abs(apart).sum(axis=1)
    return bool(np.median(same) <= _TRACKED_SHARE * np.median(others))
