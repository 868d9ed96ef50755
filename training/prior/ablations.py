"""Groups of the prior's inputs, to be left out one at a time."""

from __future__ import annotations

from dfcgs_codec.errors import InputError

#: group -> part -> columns of its inputs (spec sections 12.3, 14.3)
GROUPS: dict[str, dict[str, tuple[int, ...]]] = {
    "motion": {"flags": (0, 1, 2, 3, 4), "columns": (0, 1, 2, 3, 4), "control": (2, 3)},
    "visibility": {"flags": (5,), "columns": (5,)},
    "temporal": {
        "flags": (6, 7, 8, 9, 12, 13),
        "columns": (6, 7, 8, 9, 12, 13, 23),
        "control": (0, 1, 7),
    },
    "classes": {"flags": (10, 11), "columns": (10, 11)},
    "spatial": {"flags": (20,), "columns": (20, 21), "control": (4, 5)},
}


def masked(groups: list[str]) -> dict[str, tuple[int, ...]]:
    """Columns of each part's inputs that belong to `groups`; InputError for an unknown one."""
    found: dict[str, tuple[int, ...]] = {}
    for name in groups:
        if name not in GROUPS:
            raise InputError(f"no group of inputs {name!r}; there are {', '.join(GROUPS)}")
        for part, columns in GROUPS[name].items():
            found[part] = (*found.get(part, ()), *columns)
    return found
