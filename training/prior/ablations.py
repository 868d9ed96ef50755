"""Groups of the prior's inputs, to be left out one at a time."""

from __future__ import annotations

from dfcgs_codec.errors import InputError

#: group -> part -> columns of its inputs (spec sections 12.3, 14.3)
GROUPS: dict[str, dict[str, tuple[int, ...]]] = {
    "motion": {"flags": (0, 1, 2, 3, 4), "columns": (0, 1, 2, 3, 4), "control": (3, 4)},
    "visibility": {"flags": (5,), "columns": (5,)},
    "temporal": {
        "flags": (6, 7, 8, 9, 17, 18),
        "columns": (6, 7, 8, 9, 17, 18, 28),
        "control": (1, 2, 9),
    },
    "classes": {"flags": (10, 11), "columns": (10, 11)},
    "attributes": {"flags": (12, 13, 14, 15, 16), "columns": (12, 13, 14, 15, 16)},
    "spatial": {"flags": (25,), "columns": (25, 26), "control": (6, 7)},
    "level": {"control": (0, 5)},
}


#: the inputs that the symbols of `plain` streams have as context, by part
PLAIN_INPUTS = {
    "flags": (6, 10, 12, 13, 14, 15, 16),
    "columns": (6, 11, 25, 27, 29, 30, 31),
    "control": (1, 6, 8, 10, 11, 12),
}
#: what stands for `plain` with tables frozen in training
AS_PLAIN = "as-plain"
_WIDTHS = {"flags": 27, "columns": 35, "control": 16}


def masked(groups: list[str]) -> dict[str, tuple[int, ...]]:
    """Columns of each part's inputs that belong to `groups`; InputError for an unknown one."""
    found: dict[str, tuple[int, ...]] = {}
    if groups == [AS_PLAIN]:
        return {p: tuple(c for c in range(w) if c not in PLAIN_INPUTS[p]) for p, w in _WIDTHS.items()}
    for name in groups:
        if name not in GROUPS:
            raise InputError(f"no group of inputs {name!r}; there are {', '.join(GROUPS)}")
        for part, columns in GROUPS[name].items():
            found[part] = (*found.get(part, ()), *columns)
    return found
