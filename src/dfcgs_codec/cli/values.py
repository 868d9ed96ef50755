"""What arguments and options take besides numbers and names."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path

import click

from dfcgs_codec.arguments import rate
from dfcgs_codec.encoder.plan.quantiser_steps import QUALITIES, Bound
from dfcgs_codec.errors import InputError

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def _check_typed(value: str, what: str) -> None:
    if value == "-":
        raise InputError(f"'-': a pipe cannot be the output; name {what} (./- is one of that name)")
    if not value:
        raise InputError(f"the output has an empty name; name {what}")


def output_file(ctx: click.Context, param: click.Parameter, value: str) -> Path:
    """The path of an output file; InputError for '-' and for what is written as a folder."""
    _check_typed(value, "a file")
    if value.endswith(("/", os.sep)):
        raise InputError(
            f"{value} is the name of a folder: name a file in it, such as {Path(value, 'frames.dgs')}"
        )
    return Path(value)


def output_folder(ctx: click.Context, param: click.Parameter, value: str | None) -> Path | None:
    """The path of an output folder, where one is given; InputError for '-'."""
    if value is None:
        return None
    _check_typed(value, "a folder")
    return Path(value)


def frame_rate(text: str) -> Fraction:
    """`30`, `29.97` or `30000/1001`."""
    try:
        return rate(text)
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a frame rate such as 30, 29.97 or 30000/1001") from None


def gof_size(text: str) -> int | None:
    """A number of frames; None for `auto`."""
    if text == "auto":
        return None
    try:
        return int(text)
    except ValueError:
        raise click.BadParameter(f"{text!r} is neither auto nor a number of frames") from None


def quality(text: str) -> str | float:
    """A quality's name, `lossless`, or decibels."""
    names = (*QUALITIES, "lossless")
    if text.lower() in names:
        return text
    try:
        return float(text)
    except ValueError:
        known = ", ".join(names)
        raise click.BadParameter(f"{text!r} is none of {known}, and no PSNR in dB such as 40") from None


def bound(text: str) -> Bound:
    """`attribute=value`."""
    attribute, _, number = text.partition("=")
    try:
        return Bound(attribute, float(number))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not like position=0.001") from None


def frame_range(text: str) -> tuple[int, int | None]:
    """`A:B`, `A:`, `:B` or `A`: the first frame, and the end or None."""
    start, colon, stop = text.partition(":")
    try:
        first = int(start) if start else 0
        last = (int(stop) if stop else None) if colon else first + 1
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a range such as 10:20, 10: or 10") from None
    if first < 0 or (last is not None and last <= first):
        raise click.BadParameter(f"{text!r} holds no frames; A:B is frame A up to, not with, frame B")
    return first, last


def memory_size(text: str) -> int:
    """Bytes, written as `512M` or `4G`."""
    number = text.upper().removesuffix("IB").removesuffix("B")
    unit = number[-1:] if number[-1:] in _UNITS else ""
    try:
        size = int(float(number.removesuffix(unit)) * _UNITS[unit])
    except (ValueError, OverflowError):
        size = 0
    if size < 1:
        raise click.BadParameter(f"{text!r} is not a size such as 512M or 4G")
    return size
