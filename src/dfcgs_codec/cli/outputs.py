"""Outputs as they are typed: what a path no longer tells, such as '-' from './-'."""

from __future__ import annotations

import os
from pathlib import Path

import click

from dfcgs_codec.errors import InputError


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
