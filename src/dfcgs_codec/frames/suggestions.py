"""Advice that works: globs and --order-by patterns, tried on the names before they are printed."""

from __future__ import annotations

import fnmatch
import glob
import re
import shlex
from collections.abc import Callable, Iterable

from dfcgs_codec.frames.names import Column, Name, Token, ending

_PLACE = "{}"
_NUMBER = r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]\d{2,3})?)"


def compiled_order(pattern: str) -> re.Pattern[str]:
    """Finds the number that stands at `{}` in a name; '*' is any text. ValueError without one `{}`."""
    if pattern.count(_PLACE) != 1:
        raise ValueError(pattern)
    texts = (".*?".join(map(re.escape, text.split("*"))) for text in pattern.split(_PLACE))
    return re.compile(_NUMBER.join(texts))


def matches_glob(name: str, pattern: str) -> bool:
    """Whether the relative path fits, folder by folder, as `--pattern` would have it (without '**')."""
    parts, wanted = name.split("/"), ending_of_any_case(pattern).split("/")
    return len(parts) == len(wanted) and all(map(fnmatch.fnmatchcase, parts, wanted))


def ending_of_any_case(pattern: str) -> str:
    """'.ply' at the end of a glob stands for '.PLY', too."""
    if pattern[-4:].lower() != ".ply":
        return pattern
    return pattern[:-4] + ".[pP][lL][yY]"


def _glob(names: list[Name], number: Callable[[tuple[Token, ...]], str]) -> str:
    tokens = list(zip(*(name.tokens for name in names), strict=True))
    text = "".join(glob.escape(column[0].before) + number(column) for column in tokens)
    return text + glob.escape(names[0].after + ending(names[0].text))


def _star(column: tuple[Token, ...]) -> str:
    texts = {token.text for token in column}
    return glob.escape(column[0].text) if len(texts) == 1 else "*"


def _digits(column: tuple[Token, ...]) -> str:
    widths = {len(token.text) for token in column}
    return "[0-9]" * len(column[0].text) if len(widths) == 1 else "[0-9]*"


def glob_for(names: list[Name], others: Iterable[str] = ()) -> str | None:
    """A quoted glob that takes `names`, which are built alike, and none of `others`, or None."""
    others = list(others)
    for number in (_star, _digits):
        pattern = _glob(names, number)
        takes_all = all(matches_glob(name.text, pattern) for name in names)
        if takes_all and not any(matches_glob(other, pattern) for other in others):
            return shlex.quote(pattern)
    return None


def order_by_for(names: list[Name], column: Column) -> str | None:
    """A quoted `--order-by` pattern that finds the numbers of `column`; None if none is found."""
    first = names[0].tokens
    token = first[column.token]
    sign = "" if column.texts[0].startswith(("-", "+")) else token.sign
    before = token.before + sign
    after = first[column.token + 1].before if column.token + 1 < len(first) else names[0].after
    start = "*".join(t.before for t in first[: column.token])
    candidates = (before + _PLACE, before + _PLACE + after, f"{start}*{before}{_PLACE}{after}")
    for pattern in candidates:
        found = [compiled_order(pattern).search(name.text) for name in names]
        if all(f is not None and f[1] == text for f, text in zip(found, column.texts, strict=True)):
            return shlex.quote(pattern)
    return None
