"""Arguments as Python users give them, turned into what was meant, or refused by their names."""

from __future__ import annotations

import math
import operator
import os
from fractions import Fraction
from pathlib import Path

import numpy as np

from dfcgs_codec.errors import InputError

#: what `encode_sequence`, `decode_sequence` and `probe` take for a path
AnyPath = str | bytes | os.PathLike[str] | os.PathLike[bytes]

#: of frame rates given as decimal numbers: 29.97 is 2997/100, 30000/1001 as a float is what it was
_MAX_RATE_DENOMINATOR = 100_000


def refusal(name: str, found: object, expected: str) -> InputError:
    """The error for a value of the wrong kind."""
    shown = repr(found)
    shown = shown if len(shown) <= 60 and "\n" not in shown else "a value"
    return InputError(f"{name}: found {shown} ({type(found).__name__}), expected {expected}")


def real(name: str, value: object, expected: str = "a number") -> float:
    """`value` as a float: Python's and numpy's numbers, 0-dimensional arrays; no bool, no text."""
    if isinstance(value, (bool, np.bool_, str, bytes, bytearray)) or getattr(value, "ndim", 0) != 0:
        raise refusal(name, value, expected)
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise refusal(name, value, expected) from None


def whole(name: str, value: object, expected: str = "a whole number") -> int:
    """`value` as an int: integers of any library, and floats without a fraction."""
    number = real(name, value, expected)
    if not number.is_integer():
        raise refusal(name, value, expected)
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        return int(number)


def rate(value: object) -> Fraction:
    """A frame rate from a number or from text such as 29.97 or 30000/1001; ValueError for anything else."""
    if isinstance(value, Fraction):
        return value
    if isinstance(value, str):
        try:
            return Fraction(value).limit_denominator(_MAX_RATE_DENOMINATOR)
        except ZeroDivisionError:
            raise ValueError("no denominator may be 0") from None
    number = real("rate", value)
    if not math.isfinite(number):
        raise ValueError("no finite number")
    return Fraction(number).limit_denominator(_MAX_RATE_DENOMINATOR)


def switch(name: str, value: object) -> bool:
    """`value` as a bool; no text, number or None counts as either."""
    if not isinstance(value, (bool, np.bool_)):
        raise refusal(name, value, "True or False")
    return bool(value)


def path_of(name: str, value: object, expected: str) -> Path:
    """`value` as a Path, from text, bytes or a path of any library."""
    try:
        text = os.fsdecode(value)  # type: ignore[arg-type]
    except TypeError:
        raise refusal(name, value, expected) from None
    if not text or "\0" in text:
        raise refusal(name, value, expected)
    return Path(text)
