"""Values that are not finite, and rows without a Gaussian: found, refused, or repaired to what viewers show.

log-scale -inf        an axis without extent: FLAT_LOG_SCALE
opacity +inf, -inf    alpha 1 and 0: OPAQUE_LOGIT and INVISIBLE_LOGIT
anything else         a Gaussian that viewers do not draw: it is made invisible, in the middle of the others
zero quaternion       no rotation, as the reference renderer takes it; with log-scales that are all zero too,
                      the row was never written (it would be a disc one unit wide): it is made invisible
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dfcgs_codec.array_types import AnyArray, Bool, Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.ply.schema import FLAT_LOG_SCALE

#: alpha stays below 1, so that its logit is finite
_MOST = 1 - 1e-7
#: alpha 1 to within 3e-7, and 0 even after a quantiser step of many logits
OPAQUE_LOGIT = 15.0
INVISIBLE_LOGIT = -30.0
#: attribute -> (N, number of properties)
Groups = dict[str, AnyArray]
#: attribute -> names of its properties
Names = dict[str, tuple[str, ...]]
_ORDER = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")
_NO_ROTATION = (1.0, 0.0, 0.0, 0.0)
#: what -inf and inf mean
_MEANINGS = {"scales": (FLAT_LOG_SCALE, 0.0), "opacities": (INVISIBLE_LOGIT, OPAQUE_LOGIT)}
_LARGEST = float(np.finfo(np.float32).max)


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


class _Finding(NamedTuple):
    what: str
    remedy: str


def check_values(groups: Groups, names: Names, prefix: str, *, repair: bool) -> list[str]:
    """Check the arrays of all attributes; with `repair` mend them in place and say what was done.

    `prefix` begins each line. Raises InputError that says how many values of which kinds there are, where the
    first is and what repair does. Doubles that float32 has no room for count as infinite.
    """
    bad = {key: mask for key in _ORDER if (mask := _not_finite(groups[key])) is not None}
    zero = (groups["rotations"] == 0).all(axis=1)
    if not bad and not zero.any():
        return []
    empty = zero & (groups["scales"] == 0).all(axis=1)
    lost = empty.copy()
    for key, mask in bad.items():
        lost |= (mask & ~_meant(key, groups[key])).any(axis=1)
    findings = [_values(key, groups[key], mask, names[key]) for key, mask in bad.items()]
    findings += _quaternions(zero & ~empty, empty)
    if not repair:
        remedies = ", ".join(dict.fromkeys(f.remedy for f in findings))
        raise InputError(
            f"{prefix}: {'; '.join(f.what for f in findings)}; --repair puts what viewers show: {remedies}"
        )
    _mend(groups, bad, lost, zero)
    return [f"{prefix}: {f.what}; {f.remedy}" for f in findings]


def _not_finite(values: AnyArray) -> Bool | None:
    finite = np.isfinite(values) if values.dtype == np.float32 else np.abs(values) <= _LARGEST
    return None if finite.all() else ~finite


def _meant(key: str, values: AnyArray) -> Bool:
    """Infinities that mean something: an axis without extent, alpha 0 or 1."""
    if key == "scales":
        return np.asarray(values < -_LARGEST)
    return np.asarray(np.abs(values) > _LARGEST) if key == "opacities" else np.zeros(values.shape, bool)


def _values(key: str, values: AnyArray, mask: Bool, names: tuple[str, ...]) -> _Finding:
    row, column = np.argwhere(mask)[0]
    counts = {
        "NaN": int(np.isnan(values).sum()),
        "inf": int((values > _LARGEST).sum()),
        "-inf": int((values < -_LARGEST).sum()),
    }
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    where = names[0] if len(names) == 1 else f"{names[0]}..{names[-1]}"
    what = (
        f"{mask.sum()} values of {where} are NaN or infinite ({kinds}), "
        f"first '{names[column]}' of Gaussian {row}"
    )
    lost = int((mask & ~_meant(key, values)).any(axis=1).sum())
    remedies = [f"{lost} Gaussian{'s' * (lost > 1)} invisible"] if lost else []
    if key == "scales" and counts["-inf"]:
        remedies.append(f"-inf of a scale as {FLAT_LOG_SCALE:g} (flat)")
    if key == "opacities" and counts["inf"] + counts["-inf"]:
        remedies.append("infinite opacity as alpha 1 or 0")
    return _Finding(what, ", ".join(remedies))


def _quaternions(zero: Bool, empty: Bool) -> list[_Finding]:
    found = []
    if empty.any():
        what = (
            f"{empty.sum()} quaternions rot_0..rot_3 are zero, and so are the scales (rows that were never "
            f"written), first of Gaussian {int(empty.argmax())}"
        )
        found.append(_Finding(what, f"{empty.sum()} Gaussian{'s' * bool(empty.sum() > 1)} invisible"))
    if zero.any():
        what = f"{zero.sum()} quaternions rot_0..rot_3 are zero, first of Gaussian {int(zero.argmax())}"
        found.append(_Finding(what, "zero quaternions as no rotation"))
    return found


def _mend(groups: Groups, bad: dict[str, Bool], lost: Bool, zero: Bool) -> None:
    twins = _twins(lost)
    never_written = lost & zero
    for key in _ORDER:
        replaced = never_written
        if key in bad:
            _clip(groups[key], key)
            if key in ("positions", "scales"):
                replaced = never_written | (lost & bad[key].any(axis=1))
        groups[key][replaced] = groups[key][twins[replaced]]
    unturned = (groups["rotations"] == 0).all(axis=1)
    if "rotations" in bad:
        unturned |= bad["rotations"].any(axis=1)
    groups["rotations"][unturned] = _NO_ROTATION
    groups["opacities"][lost] = INVISIBLE_LOGIT
    if lost.all():
        groups["scales"][:] = FLAT_LOG_SCALE


def _twins(lost: Bool) -> Int64:
    """For each lost Gaussian another that is not, in the order of the file; without any, itself."""
    twins, seen, count = np.arange(len(lost)), np.flatnonzero(~lost), int(lost.sum())
    if len(seen) and count:
        twins[lost] = seen[np.arange(count) * len(seen) // count]
    return twins


def _clip(values: AnyArray, key: str) -> None:
    """Infinities that mean something become what they mean, other values that are not finite zero."""
    low, high = _MEANINGS.get(key, (0.0, 0.0))
    values[values < -_LARGEST] = low
    values[values > _LARGEST] = high
    values[np.isnan(values)] = 0
