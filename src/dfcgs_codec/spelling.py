"""How options are called in messages: `--allow-gaps` on the command line, `allow_gaps=True` in Python.

Messages and notes are written once, with the names of the command line; whoever calls the package as a
library reads Python's names instead.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

#: what is not its own name with underscores; a phrase with its value, where Python's value is another one
PYTHON = {
    "--allow-gaps": "open_folder(..., allow_gaps=True)",
    "--pattern": "the pattern of open_folder()",
    "--order-by": "the order_by of open_folder()",
    "--drop-extra": "open_folder(..., policy=InputPolicy(drop_extra=True))",
    "--repair": "open_folder(..., policy=InputPolicy(repair=True))",
    "--force": "force=True",
    "--fps": "frame_rate",
    "--bound": "bounds",
    "--psnr": "quality",
    "--control-neighbours": "num_neighbours",
    "--profile main": 'profile="main"',
    "--profile paper": 'profile="paper"',
    "--intra coded": 'intra="coded"',
    "--intra ply": 'intra="ply"',
    "--steps": "visibility",
    "--steps visibility": "visibility=True",
    "--steps uniform": "visibility=False",
    "--balance auto": "balance=True",
    "--exact off": "exact=False",
}
#: not in the middle of a word or of a path
_OPTION = r"(?<![\w./-])"
#: advice with a value that works as it stands, quoted as a shell needs it
_CHOICE = r"--(?P<choice>pattern|order-by) (?P<value>'[^']*'|name\b|number\b|[\w/-]+\.ply\b)"
_KNOWN = "|".join(re.escape(phrase) + r"(?![\w-])" for phrase in sorted(PYTHON, key=len, reverse=True))
_PHRASE = re.compile(f"{_OPTION}(?:{_CHOICE}|{_KNOWN}|--[a-z][a-z-]*[a-z])")
_on_command_line: ContextVar[bool] = ContextVar("on_command_line", default=False)


@contextmanager
def command_line() -> Iterator[None]:
    """Inside, messages keep the names of the command line."""
    token = _on_command_line.set(True)
    try:
        yield
    finally:
        _on_command_line.reset(token)


def in_python(message: str) -> str:
    """`message` with Python's names of the options in it."""
    return _PHRASE.sub(_name, message)


def _name(found: re.Match[str]) -> str:
    if found["choice"]:
        value = found["value"].strip("'")
        return f"open_folder(..., {_underscored(found['choice'])}={value!r})"
    return PYTHON.get(found[0], _underscored(found[0][2:]))


def _underscored(option: str) -> str:
    return option.replace("-", "_")


def spelled(message: str) -> str:
    """`message` for whoever reads it: the user of the command line, or of the package."""
    return message if _on_command_line.get() else in_python(message)
