"""Names that do not say which order is meant: what is wrong with them, and ways out that were tried."""

from __future__ import annotations

import fnmatch
import glob
import re
import shlex
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.names import Column, Name, Token, columns, ending

_PLACE = "{}"
_NUMBER = r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]\d{2,3})?)"
#: names that are listed in a message
_LISTED = 3


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


def counted(names: Sequence[object], what: str = "file") -> str:
    """How many there are: "1 file", "2 files"."""
    return f"1 {what}" if len(names) == 1 else f"{len(names)} {what}s"


def some(names: list[str]) -> str:
    """A few of the names, and how many more there are."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def unlike(groups: list[list[Name]]) -> InputError:
    """Names without numbers, or built differently: the odd ones out, or the kinds."""
    if not any(name.tokens for group in groups for name in group):
        texts = sorted(name.text for group in groups for name in group)
        return InputError(
            f"no number in the names ({some(texts)}) says in which order the frames are; name them like "
            "frame_0000.ply, choose them with --pattern, or --order-by name takes all by name"
        )
    most, others = groups[0], [name.text for group in groups[1:] for name in group]
    pattern = glob_for(most, others)
    if len(most) > max(len(others), 1):
        return _odd_ones_out(most, others, pattern)
    kinds = [f"{len(group)} like {group[0].text}" for group in groups[:_LISTED]]
    choice = f"--pattern {pattern} takes the first kind" if pattern else "choose frames with --pattern"
    return InputError(
        f"file names do not share one numbering ({', '.join(kinds)}); {choice}, "
        "--order-by name takes all by name"
    )


def _odd_ones_out(most: list[Name], others: list[str], pattern: str | None) -> InputError:
    are, them = ("is", "it") if len(others) == 1 else ("are", "them")
    leave = f"--pattern {pattern} leaves {them} out" if pattern else f"move {them} elsewhere"
    return InputError(
        f"{some(others)} {are} not named like the other {len(most)} files (such as {most[0].text}); {leave}, "
        "--order-by name takes all by name"
    )


def repeated(found: list[Column], names: list[Name]) -> InputError:
    """No number is different in every file: two with the same."""
    varying = [column for column in found if len(set(column.values)) > 1] or found
    best = max(varying, key=lambda column: len(set(column.values)))
    first, second = _pair(best, names)
    if len(varying) == 1:
        return InputError(
            f"{first} and {second} have the same frame number; take one of them away, or choose frames with "
            "--pattern"
        )
    # those first that take most files
    fixed = sorted(varying, key=lambda column: len(set(column.values)))
    globs = [g for column in fixed if (g := _one_value(column, names)) is not None]
    choice = f"such as {' or '.join(globs[:2])}" if globs else "so that one varies"
    return InputError(
        f"{first} and {second} have the same frame number: {len(varying)} numbers in the names vary and each "
        f"repeats; choose frames with --pattern {choice}, or --order-by name takes all by name"
    )


def _pair(column: Column, names: list[Name]) -> tuple[str, str]:
    seen: dict[Fraction, str] = {}
    for value, name in zip(column.values, names, strict=True):
        if value in seen:
            return seen[value], name.text
        seen[value] = name.text
    raise AssertionError("numbers are distinct")


def _one_value(column: Column, names: list[Name]) -> str | None:
    """A glob for the names with the last value of `column`, where another number tells these apart."""
    last = max(column.values)
    chosen = [name for name, value in zip(names, column.values, strict=True) if value == last]
    others = [name.text for name, value in zip(names, column.values, strict=True) if value != last]
    if len(chosen) < 2 or not any(c.is_distinct for c in columns(chosen)):
        return None
    return glob_for(chosen, others)


def two_choices(first: Column, second: Column, names: list[Name]) -> InputError:
    """Two numbers that are different in every file."""
    ways = [order_by_for(names, column) for column in (first, second)]
    known = [f"--order-by {way}" for way in ways if way is not None]
    return InputError(
        f"two numbers differ in every name: {first.texts[0]} and {second.texts[0]} in {names[0].text}, "
        f"{first.texts[-1]} and {second.texts[-1]} in {names[-1].text}; say which one counts: "
        + (" or ".join(known) or "--order-by with {} in its place")
    )


def check_doubts(column: Column, found: list[Column], names: list[Name]) -> None:
    """InputError for numbers that may be meant otherwise: an order is not guessed."""
    if column.doubt:
        raise InputError(
            f"'.{column.doubt}' in the names: {some(list(column.texts))} are decimal numbers, or two numbers "
            "each; write decimals with equally many digits (0.05, 0.10), or --order-by name takes two numbers"
        )
    if column.is_gapless:
        return
    way = order_by_for(names, column)
    if column.is_unevenly_padded and not column.is_decimal:
        raise InputError(
            f"the numbers {some(sorted(column.texts, key=len))} have gaps and are padded with zeros "
            f"unevenly: decimals are written like 0.05; --order-by {way or 'with {}'} takes whole numbers"
        )
    varying = [c for c in found if len(set(c.values)) > 1]
    natural = sorted(range(len(names)), key=lambda i: [c.values[i] for c in varying])
    if natural != sorted(range(len(names)), key=lambda i: column.values[i]):
        other = next(c for c in varying if c.values != column.values)
        alone = f", --order-by {way} {column.texts[0]} alone" if way else ""
        raise InputError(
            f"two numbers in the names disagree on the order: {column.texts[0]} and {other.texts[0]} in "
            f"{names[0].text}, {column.texts[-1]} and {other.texts[-1]} in {names[-1].text}; --order-by name "
            f"takes all numbers from left to right{alone}"
        )
