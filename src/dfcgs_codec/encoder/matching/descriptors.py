"""What a Gaussian is recognised by when the order is lost: the bits that stayed, and its appearance."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, UInt64
from dfcgs_codec.encoder.matching.nearest import WEIGHTS, Pairs, ranks, runs
from dfcgs_codec.gaussians import GaussianCloud

_EVERYTHING = ("position", "rotation", "scale", "opacity", "sh")
_APPEARANCE = ("scale", "opacity", "sh")
#: what may have stayed as it was, in the order tried: less and less of a Gaussian
_KEYS = (_EVERYTHING, _APPEARANCE, ("scale", "sh"), ("opacity", "sh"), ("sh",), ("scale",), ("position",))
#: part of a Gaussian is a key where at least this share of a frame's keys differ
_DISTINCT_SHARE = 0.95
#: Gaussians looked at to see whether an attribute stayed anywhere, about
_SAMPLE = 4096


def _attribute_keys(cloud: GaussianCloud) -> dict[str, UInt64]:
    """(N,) hash of each attribute's bits: their sum modulo 2**64, weighted.

    Rows that differ in one number have different hashes. Sums of hashes are hashes of several attributes.
    """
    rest = cloud.sh_rest.reshape(cloud.num_gaussians, 3 * cloud.sh_rest.shape[2])
    tables = (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities[:, None], cloud.sh_dc, rest)
    hashes, weights = [], WEIGHTS
    for table in tables:
        bits = (table + table.dtype.type(0.0)).view(f"u{table.itemsize}")  # the sum turns -0.0 into 0.0
        hashes.append(np.einsum("nc,c->n", bits, weights[: table.shape[1]]))
        weights = weights[table.shape[1] :]
    return dict(zip(_EVERYTHING, [*hashes[:4], hashes[4] + hashes[5]], strict=True))


def _joined(keys: dict[str, UInt64], names: tuple[str, ...]) -> UInt64:
    total: UInt64 = np.sum([keys[name] for name in names], axis=0, dtype=np.uint64)
    return total


def _any_equal(before: UInt64, now: UInt64) -> bool:
    """Whether any of a sample of `now` is in `before`."""
    some = np.sort(now[:: max(1, len(now) // _SAMPLE)])
    return bool((some[np.searchsorted(some, before) % len(some)] == before).any())


def _numbered(keys: UInt64) -> UInt64:
    """Keys in which the first, second, ... holder of a key differ."""
    numbered: UInt64 = keys + ranks(keys).view(np.uint64) * WEIGHTS[-1]
    return numbered


def _once_in_both(before: UInt64, now: UInt64) -> Pairs:
    keys = np.concatenate([before, now])
    order = np.argsort(keys)
    starts, lengths = runs(keys[order])
    twice = starts[lengths == 2]
    pairs = np.sort(np.stack([order[twice], order[twice + 1]]), axis=0)
    first, second = pairs[:, (pairs[0] < len(before)) & (pairs[1] >= len(before))]
    return first, second - len(before)


def _tells_apart(keys: UInt64) -> bool:
    return len(np.unique(keys)) >= _DISTINCT_SHARE * len(keys)


def match_bits(before: GaussianCloud, now: GaussianCloud) -> Int64:
    """Index in `before` of each Gaussian of `now`, (N_now,), -1 where bits alone do not tell.

    Partners have attributes equal bit for bit that no other Gaussian has. Of Gaussians equal in everything
    any will do; those of the same appearance are left to geometry.
    """
    keys_before, keys_now = _attribute_keys(before), _attribute_keys(now)
    stayed = {name for name in _EVERYTHING if _any_equal(keys_before[name], keys_now[name])}
    partner = np.full(now.num_gaussians, -1, np.int64)
    free = np.arange(before.num_gaussians)
    for names in _KEYS:
        if not stayed.issuperset(names):
            continue
        first, second = _joined(keys_before, names), _joined(keys_now, names)
        if names == _EVERYTHING:
            first, second = _numbered(first), _numbered(second)
        lost = np.flatnonzero(partner < 0)
        old, new = _once_in_both(first[free], second[lost])
        if names in (_EVERYTHING, _APPEARANCE) or (len(old) and _tells_apart(first)):
            partner[lost[new]] = free[old]
            free = np.delete(free, old)
    return partner


def appearance(cloud: GaussianCloud) -> Float64:
    """(N, 10): sh_dc, scales, opacity, and the direction of the first axis: the same for q and -q."""
    wide = cloud.rotations.astype(np.float64)
    w, x, y, z = (wide / np.linalg.norm(wide, axis=1, keepdims=True)).T
    axis = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    return np.concatenate([cloud.sh_dc, cloud.scales, cloud.opacities[:, None], axis], axis=1)


def spread(values: Float64) -> Float64:
    """Standard deviation of each column, whatever outliers there are; 1 where there is none."""
    low, high = np.quantile(values, [0.1, 0.9], axis=0)
    deviation: Float64 = np.where(high > low, (high - low) / 2.56, 1.0)
    return deviation


def features(positions: Float64, appearances: Float64, units: Float64) -> Float64:
    """(N, 13) positions and appearances, each column in its unit."""
    return np.concatenate([positions, appearances], axis=1) / units
