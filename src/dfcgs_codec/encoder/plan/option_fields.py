"""Fields of `EncoderOptions` that take what a Python user passes by habit, and hold one exact type.

A field is a descriptor: a dataclass passes what it is given to `__set__`, which converts it or raises
InputError that names the field, what was found and what was expected. Ranges are the options' own affair.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from enum import Enum
from fractions import Fraction
from typing import Any, Generic, TypeVar

from dfcgs_codec.arguments import AnyPath, rate, real, refusal, whole
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import Views
from dfcgs_codec.views.read import read_views

_Held = TypeVar("_Held")
_Given = TypeVar("_Given")
_Named = TypeVar("_Named", bound=Enum)


class OptionField(Generic[_Held, _Given]):
    """A field with a default; `convert` makes what is held of its name and of what it is given."""

    def __init__(self, default: _Held, convert: Callable[[str, Any], _Held]) -> None:
        self._default, self._convert = default, convert

    def __set_name__(self, owner: type, name: str) -> None:
        self._key, self._name = name, f"{owner.__name__}.{name}"

    def __get__(self, instance: object | None, owner: type) -> _Held:
        if instance is None:
            return self._default
        held: _Held = instance.__dict__[self._key]
        return held

    def __set__(self, instance: object, value: _Given) -> None:
        instance.__dict__[self._key] = self._convert(self._name, value)


Switch = OptionField[bool, bool]
Real = OptionField[float, float]
Whole = OptionField[int, int]
Choice = OptionField[_Named, _Named | str]


def all_cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def real_or_name(names: Mapping[str, float]) -> Callable[[str, Any], float]:
    """Takes a number, or the name of one."""

    def convert(name: str, value: Any) -> float:
        if isinstance(value, str) and value.lower() in names:
            return float(names[value.lower()])
        return real(name, value, f"a number or one of {_quoted(names)}")

    return convert


def choice(default: _Named) -> Choice[_Named]:
    """A field that takes a member of an enumeration, or its name in small letters."""
    kind = type(default)
    names = {member.name.lower(): member for member in kind}

    def convert(name: str, value: Any) -> _Named:
        if isinstance(value, kind):
            return value
        if isinstance(value, str) and value.lower() in names:
            return names[value.lower()]
        raise refusal(name, value, f"one of {_quoted(names)}")

    return OptionField(default, convert)


def qp_or_none(name: str, value: Any) -> float | None:
    """Takes a number; None leaves the choice to the encoder."""
    expected = 'a number, or None (a quality has its own option: quality="high")'
    return None if value is None else real(name, value, expected)


def whole_or_auto(name: str, value: Any) -> int | None:
    """Takes a whole number; None or "auto" leaves the choice to the encoder."""
    if value is None or (isinstance(value, str) and value.lower() == "auto"):
        return None
    return whole(name, value, 'a whole number, or "auto" or None')


def processes(name: str, value: Any) -> int:
    """Takes a number of processes; None is one for each core."""
    return all_cores() if value is None else whole(name, value, "a whole number, or None: all cores")


def frame_rate(name: str, value: Any) -> Fraction:
    """Takes frames per second."""
    try:
        return rate(value)
    except (ValueError, InputError):
        expected = 'a frame rate such as 30, 29.97, "30000/1001" or a Fraction'
        raise refusal(name, value, expected) from None


def cameras(name: str, value: Views | AnyPath | None) -> Views | None:
    """Takes Views, the path of a file or a folder of cameras, which is read at once, or None."""
    return value if value is None or isinstance(value, Views) else read_views(value)


def _quoted(names: Mapping[str, Any]) -> str:
    return ", ".join(f'"{name}"' for name in names)
