"""The order of frames, from the numbers in their names."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from fractions import Fraction

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.names import Column, Name, columns, groups, parse
from dfcgs_codec.frames.refusals import check_doubts, compiled_order, repeated, two_choices, unlike

BY_NAME, BY_NUMBER = "name", "number"
_MAX_NUMBER = (1 << 32) - 1
_TOO_LARGE = 1 << 63


@dataclass(frozen=True)
class Order:
    """`index`: the names in the order of frames; `numbers`: of these frames, ascending; `notes` on both."""

    index: list[int]
    numbers: list[int]
    notes: list[str]


def _by_name(names: list[str]) -> Order:
    def key(index: int) -> tuple[list[tuple[int, int, str]], str]:
        pieces = re.split(r"(\d+)", names[index].casefold())
        natural = [(int(p), 0, "") if i % 2 else (-1, 0, p) for i, p in enumerate(pieces)]
        return natural, names[index]

    index = sorted(range(len(names)), key=key)
    first, last = names[index[0]], names[index[-1]]
    note = f"frames are in the order of their names ({first} is 0, {last} is {len(names) - 1})"
    return Order(index, list(range(len(names))), [note])


def _chosen(found: list[Column], names: list[Name]) -> Column:
    """The number that varies over all frames without repeating."""
    distinct: list[Column] = []
    for column in found:
        if column.is_distinct and column.values not in [other.values for other in distinct]:
            distinct.append(column)
    if not distinct:
        raise repeated(found, names)
    if len(distinct) > 1:
        raise two_choices(distinct[0], distinct[1], names)
    return distinct[0]


def _check_gaps(values: list[int], names: list[str]) -> None:
    for position, (before, after) in enumerate(itertools.pairwise(values)):
        if after != before + 1:
            raise InputError(
                f"frames {before + 1} to {after - 1} are missing (after {names[position]}); "
                "--allow-gaps encodes the others" + " and keeps their numbers" * (values[0] >= 0)
            )


def _numbered(column: Column, names: list[str], allow_gaps: bool) -> Order:
    """Frames by the numbers of `column`, which are kept where the file can hold them."""
    index = sorted(range(len(names)), key=lambda i: column.values[i])
    values, ordered = [column.values[i] for i in index], [names[i] for i in index]
    if not column.is_decimal and max(values) >= _TOO_LARGE:
        raise InputError(
            f"{ordered[-1]}: frame number {values[-1]} is above {_TOO_LARGE - 1}; rename the frames"
        )
    kind = "decimal numbers" if column.is_decimal else "negative numbers" if values[0] < 0 else ""
    if values[-1] > _MAX_NUMBER and not kind:
        kind = f"time stamps (numbers above {_MAX_NUMBER})"
    elif not column.is_decimal and not allow_gaps:
        _check_gaps([int(value) for value in values], ordered)
    if not kind:
        return Order(index, [int(value) for value in values], [])
    last = f", {ordered[-1]} is {len(ordered) - 1}" if len(ordered) > 1 else ""
    note = f"{kind} in the names: frames are in their order and numbered from 0 ({ordered[0]} is 0{last})"
    return Order(index, list(range(len(index))), [note])


def _by_pattern(names: list[str], pattern: str, allow_gaps: bool) -> Order:
    try:
        wanted = compiled_order(pattern)
    except ValueError:
        raise InputError(
            f"--order-by {pattern!r} is neither name, number nor a part of the names with {{}} in place "
            "of the number that counts, such as 'frame_{}'"
        ) from None
    texts = []
    for name in names:
        match = wanted.search(name)
        if match is None:
            raise InputError(f"{name}: --order-by {pattern!r} finds no number in this name")
        texts.append(match[1].replace(",", "."))
    is_decimal = any(re.search("[.eE]", text) for text in texts)
    column = Column(0, tuple(map(Fraction, texts)), tuple(texts), is_decimal)
    if not column.is_distinct:
        raise repeated([column], [parse(name) for name in names])
    return _numbered(column, names, allow_gaps)


def _that_count(found: list[Column]) -> list[Column]:
    others = [column for column in found if not column.is_iteration]
    is_one = all(len(column.values) == 1 for column in found)
    return others if is_one or any(len(set(column.values)) > 1 for column in others) else found


def order_of(names: list[str], order_by: str = BY_NUMBER, *, allow_gaps: bool = False) -> Order:
    """The order of frames called `names` (relative paths, at least one).

    `order_by`: "number", "name", or a part of the names with {} in place of the number that counts.
    InputError for names that are not built alike, for no number or several that tell them apart, for
    missing numbers (unless `allow_gaps`; decimal numbers and time stamps may have gaps) and numbers of 2^63
    and above.
    """
    if order_by == BY_NAME:
        return _by_name(names)
    if order_by != BY_NUMBER:
        return _by_pattern(names, order_by, allow_gaps)
    found = groups([parse(name) for name in names])
    if len(found) > 1:
        raise unlike(found)
    alike = found[0]
    numbers = _that_count(columns(alike))
    if len(names) == 1:
        column = numbers[-1] if numbers else Column(0, (Fraction(0),), ("0",))
        return _numbered(column, names, allow_gaps)
    if not numbers:
        raise unlike(found)
    column = _chosen(numbers, alike)
    check_doubts(column, numbers, alike)
    return _numbered(column, names, allow_gaps)
