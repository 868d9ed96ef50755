"""Fields of `EncoderOptions` that take what a Python user passes by habit, and hold one exact type.

A field is a descriptor: a dataclass passes what it is given to `__set__`, which converts it or raises
InputError that names the field, what was found and what was expected. Ranges are the options' own affair.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import Enum
from fractions import Fraction
from typing import Any, Generic, TypeVar

from dfcgs_codec.arguments import AnyPath, rate, real, refusal, switch, whole
from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import Views
from dfcgs_codec.views.read import read_views

_Held = TypeVar("_Held")
_Given = TypeVar("_Given")
_Named = TypeVar("_Named", bound=Enum)


def all_cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class OptionField(ABC, Generic[_Held, _Given]):
    """A field that converts what it is given; the class holds the default."""

    def __init__(self, default: _Held) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._key, self._name = name, f"{owner.__name__}.{name}"

    def __get__(self, instance: object | None, owner: type) -> _Held:
        if instance is None:
            return self._default
        held: _Held = instance.__dict__[self._key]
        return held

    def __set__(self, instance: object, value: _Given) -> None:
        instance.__dict__[self._key] = self._convert(value)

    @abstractmethod
    def _convert(self, value: Any) -> _Held:
        """What is held of `value`; InputError for what does not fit."""


class Switch(OptionField[bool, bool]):
    """True or False, also numpy's; no other value counts as either."""

    def _convert(self, value: Any) -> bool:
        return switch(self._name, value)


class Real(OptionField[float, float]):
    """A number."""

    def _convert(self, value: Any) -> float:
        return real(self._name, value)


class NamedReal(OptionField[float, float | str]):
    """A number, or the name of one."""

    def __init__(self, default: float, names: Mapping[str, float]) -> None:
        super().__init__(default)
        self._names = names

    def _convert(self, value: Any) -> float:
        if isinstance(value, str) and value.lower() in self._names:
            return float(self._names[value.lower()])
        return real(self._name, value, f"a number or one of {_quoted(self._names)}")


class RealOrNone(OptionField[float | None, float | None]):
    """A number; None leaves the choice to the encoder. `hint`: what is said to whoever gives no number."""

    def __init__(self, default: float | None, hint: str) -> None:
        super().__init__(default)
        self._expected = f"a number, or None ({hint})"

    def _convert(self, value: Any) -> float | None:
        return None if value is None else real(self._name, value, self._expected)


class Whole(OptionField[int, int]):
    """A whole number."""

    def _convert(self, value: Any) -> int:
        return whole(self._name, value)


class WholeOrAuto(OptionField[int | None, int | str | None]):
    """A whole number; None or "auto" leaves the choice to the encoder."""

    def _convert(self, value: Any) -> int | None:
        if value is None or (isinstance(value, str) and value.lower() == "auto"):
            return None
        return whole(self._name, value, 'a whole number, or "auto" or None')


class Processes(OptionField[int, int | None]):
    """A number of processes; None is one for each core."""

    def _convert(self, value: Any) -> int:
        return (
            all_cores() if value is None else whole(self._name, value, "a whole number, or None: all cores")
        )


class Rate(OptionField[Fraction, Fraction | float | str]):
    """Frames per second."""

    def _convert(self, value: Any) -> Fraction:
        try:
            return rate(value)
        except (ValueError, InputError):
            expected = 'a frame rate such as 30, 29.97, "30000/1001" or a Fraction'
            raise refusal(self._name, value, expected) from None


class Text(OptionField[str | None, str | None]):
    """A text or None."""

    def _convert(self, value: Any) -> str | None:
        if value is not None and not isinstance(value, str):
            raise refusal(self._name, value, "a text or None")
        return value


class Cameras(OptionField[Views | None, Views | AnyPath | None]):
    """Views, the path of a file or a folder of cameras, which is read at once, or None."""

    def _convert(self, value: Any) -> Views | None:
        return value if value is None or isinstance(value, Views) else read_views(value)


class Choice(OptionField[_Named, _Named | str]):
    """A member of an enumeration, or its name in small letters."""

    def __init__(self, default: _Named) -> None:
        super().__init__(default)
        self._names = {member.name.lower(): member for member in type(default)}

    def _convert(self, value: Any) -> _Named:
        if isinstance(value, type(self._default)):
            return value
        if isinstance(value, str) and value.lower() in self._names:
            return self._names[value.lower()]
        raise refusal(self._name, value, f"one of {_quoted(self._names)}")


def _quoted(names: Mapping[str, Any]) -> str:
    return ", ".join(f'"{name}"' for name in names)
