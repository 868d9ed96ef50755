"""Which Gaussian of the input is which one of the GoF, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.encoder.frame.targets import Planes, ordered
from dfcgs_codec.encoder.matching.canonical import AxisNames
from dfcgs_codec.encoder.matching.matching import match
from dfcgs_codec.gaussians import GaussianCloud

#: Gaussians looked at
_SAMPLE = 4096
#: median displacement of equal indices, as part of other pairs' distance, up to which they are the same
_TRACKED_SHARE = 0.25
#: with fewer survivors than this share of a frame, nothing is gained over an I-frame
_MIN_SURVIVORS = 0.3


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


@dataclass(frozen=True)
class Members:
    """The Gaussians of a GoF: `rows` (N,) in the input frame, in GoF order, and their axis names, or None."""

    rows: Int64
    names: AxisNames | None

    def target(self, planes: Planes, before: tuple[Planes, Planes] | None = None) -> Planes:
        """Planes of the input frame in GoF order, axes renamed.

        `before`: planes of the frame before, of the same members, in the input's and in GoF order; what is
        the same object there is the same here.
        """
        known = {} if before is None else {a: before[1][a] for a in planes if planes[a] is before[0][a]}
        found = ordered({a: values for a, values in planes.items() if a not in known}, self.rows)
        if self.names is not None:
            found = self.names.rename(found)
        return {a: known[a] if a in known else found[a] for a in planes}

    def values(self, cloud: GaussianCloud, field: str) -> Float32:
        """An array of the input frame in GoF order, axes renamed, to be compared with decoded values."""
        values: Float32 = getattr(cloud, field)[self.rows]
        if self.names is not None and field == "scales":
            return self.names.rename_scales(values)
        if self.names is not None and field == "rotations":
            return self.names.rename_rotations(values)
        return values

    def merge(self, births: Members, source: Int64) -> Members:
        """With `births`: row i of the result is row source[i] of these and those."""
        names = None
        if self.names is not None and births.names is not None:
            names = self.names.merge(births.names, source)
        return Members(np.concatenate([self.rows, births.rows])[source], names)


@dataclass(frozen=True)
class Succession:
    """From frame to frame: GoF rows `kept`, ascending, the members that survive, `births` in the input.

    `num_before`: how many there were.
    """

    num_before: int
    kept: Int64
    members: Members
    births: Int64

    @property
    def all_survive(self) -> bool:
        """Whether nobody goes."""
        return len(self.kept) == self.num_before


def same_members(members: Members) -> Succession:
    """All go on, in the input's order of before."""
    everyone = np.arange(len(members.rows))
    return Succession(len(everyone), everyone, members, np.zeros(0, np.int64))


def found_members(
    members: Members, before: GaussianCloud, now: GaussianCloud, moved: Float64 | None
) -> Succession | None:
    """Who of `members`, rows of the input frame `before`, is who in `now`; None where too few are found.

    `moved` (N, 3): how far each of the members went in the frame before.
    """
    expected = None
    if moved is not None:
        expected = np.full((before.num_gaussians, 3), np.nan)
        expected[members.rows] = moved
    partner = match(before, now, expected)
    if np.count_nonzero(partner >= 0) < _MIN_SURVIVORS * now.num_gaussians:
        return None
    successor = np.full(before.num_gaussians, -1)
    known = np.flatnonzero(partner >= 0)
    successor[partner[known]] = known
    rows = successor[members.rows]
    kept = np.flatnonzero(rows >= 0)
    if not len(kept):
        return None
    names = None if members.names is None else members.names.take(kept)
    return Succession(len(members.rows), kept, Members(rows[kept], names), np.flatnonzero(partner < 0))
