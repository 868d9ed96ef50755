"""Paths as Python users give them."""

from __future__ import annotations

import os
from pathlib import Path

from dfcgs_codec.errors import InputError

#: `encode_sequence`, `decode_sequence` and `probe` take any of these
AnyPath = str | bytes | os.PathLike[str] | os.PathLike[bytes]


def path_of(argument: str, value: object, expected: str) -> Path:
    """`value` as a Path; InputError that names the argument for anything but the name of a file or folder."""
    try:
        name = os.fsdecode(value)  # type: ignore[arg-type]
    except TypeError:
        raise InputError(f"{argument}: found a {type(value).__name__}, expected {expected}") from None
    if not name or "\0" in name:
        raise InputError(f"{argument}: {name!r} names no file, expected {expected}")
    return Path(name)
