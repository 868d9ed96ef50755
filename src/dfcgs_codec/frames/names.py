"""File names taken apart: the texts and numbers in them, and names that are built alike.

What is a number: digits, with a decimal point or comma between digits ("0.05", "0,05"), an exponent as
Python writes it ("1e-05"), and a sign. The dot after a letter or '_' is none: "frame.0001" is 1. Three or
more groups ("1.2.3", "2024.01.05") are versions or dates: as many whole numbers.

A minus before digits is a sign where some names have it and others lack it at the same place ("frame-1",
"frame1"), or where it follows '_', '=', '-', '(' or nothing ("frame_-1", "-1"); elsewhere it separates
("scene-1", "2024-01-05").
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from fractions import Fraction

#: endings are no part of what is compared: letters first, so that "frame.0001" keeps its number
_ENDING = re.compile(r"\.[A-Za-z][A-Za-z0-9]*$")
_TOKEN = re.compile(r"(?P<sign>(?<!\d)[+-])?(?P<digits>\d+(?:[.,]\d+)*)(?P<exponent>[eE][+-]\d{2,3}(?!\d))?")
#: a folder of one training iteration
ITERATION = re.compile(r"(?P<kind>iteration|iter|step)[_-]?(?P<number>\d+)", re.IGNORECASE)
_SIGN_FOLLOWS = ("_", "=", "-", "(", "/")
#: of names that share a place, so many have a fraction where it holds decimals; fewer are odd ones out
_FRACTIONAL_SHARE = 0.25


@dataclass(frozen=True)
class Token:
    """A number in a name as it stands there, and the text before it; `parts`: its groups of digits."""

    before: str
    text: str
    sign: str
    parts: tuple[str, ...]
    exponent: str

    @property
    def value(self) -> Fraction:
        """As a decimal number of one or two groups, without the sign."""
        return Fraction(".".join(self.parts) + self.exponent)

    @property
    def is_fractional(self) -> bool:
        """Whether it can only be read as one decimal number, or as two."""
        return len(self.parts) == 2 or bool(self.exponent)


@dataclass(frozen=True)
class Name:
    """A file's name below its folder, as numbers and texts."""

    text: str
    tokens: tuple[Token, ...]
    after: str

    def shape(self, *, decimals: bool) -> tuple[str | int, ...]:
        """Equal for names that are built alike; `decimals`: "1" and "1.5" at one place are alike."""
        parts = [1 if decimals and len(t.parts) == 2 else len(t.parts) for t in self.tokens]
        return (*[t.before.casefold() for t in self.tokens], self.after.casefold(), *parts)


def ending(text: str) -> str:
    """The ending of a file's name with its dot, or ''."""
    found = _ENDING.search(text)
    return found[0] if found else ""


def parse(text: str) -> Name:
    """Take the name apart; its ending is left out."""
    stem = text.removesuffix(ending(text))
    tokens, end = [], 0
    for match in _TOKEN.finditer(stem):
        parts = tuple(re.split("[.,]", match["digits"]))
        before, exponent = stem[end : match.start()], (match["exponent"] or "").lower()
        tokens.append(Token(before, match[0], match["sign"] or "", parts, exponent))
        end = match.end()
    return Name(text, tuple(tokens), stem[end:])


def groups(names: list[Name]) -> list[list[Name]]:
    """Names that are built alike, the largest group first; decimals of any length are."""

    def by_shape(decimals: bool) -> list[list[Name]]:
        found: dict[tuple[str | int, ...], list[Name]] = {}
        for name in names:
            found.setdefault(name.shape(decimals=decimals), []).append(name)
        return sorted(found.values(), key=len, reverse=True)

    strict = by_shape(False)
    loose = by_shape(True)
    return loose if len(strict) > 1 and all(_decimals_are_meant(group) for group in loose) else strict


def _decimals_are_meant(names: list[Name]) -> bool:
    """Not where "frame_0002.1" is a copy beside frame_0001 to frame_0300."""
    for column in zip(*(name.tokens for name in names), strict=True):
        fractional = [token for token in column if len(token.parts) == 2]
        padded = any(len(token.parts[0]) > 1 and token.parts[0].startswith("0") for token in column)
        if 0 < len(fractional) < len(names) and (padded or len(fractional) < _FRACTIONAL_SHARE * len(names)):
            return False
    return True


@dataclass(frozen=True)
class Column:
    """The numbers at one place of names that are built alike; `token`: which of them, from the left.

    `is_decimal`: not whole numbers; `doubt`: digits that may be meant otherwise, or ''.
    `is_iteration`: of folders of training iterations, which tell no frames apart.
    """

    token: int
    values: tuple[Fraction, ...]
    texts: tuple[str, ...]
    is_decimal: bool = False
    doubt: str = ""
    is_iteration: bool = False

    @property
    def is_distinct(self) -> bool:
        """Whether no number repeats."""
        return len(set(self.values)) == len(self.values)

    @property
    def is_gapless(self) -> bool:
        """Whether the numbers are whole and follow each other, in some order."""
        return (
            not self.is_decimal
            and self.is_distinct
            and max(self.values) - min(self.values) == len(self.values) - 1
        )

    @property
    def is_unevenly_padded(self) -> bool:
        """Like "1" beside "05": no single width of zero padding gives these."""
        digits = [text.lstrip("+-") for text in self.texts]
        widths = {len(d) for d in digits if d.startswith("0") and len(d) > 1}
        return bool(widths) and (len(widths) > 1 or min(len(d) for d in digits) < max(widths))


def _is_signed(tokens: tuple[Token, ...]) -> bool:
    signs = {token.sign for token in tokens}
    if "-" not in signs:
        return False
    before = tokens[0].before
    return len(signs) > 1 or not before or before.endswith(_SIGN_FOLLOWS)


def _whole(tokens: tuple[Token, ...], index: int, part: int, signed: bool) -> Column:
    digits = [token.parts[part] for token in tokens]
    texts = tuple((token.sign if signed else "") + d for token, d in zip(tokens, digits, strict=True))
    values = tuple(Fraction(int(text)) for text in texts)
    return Column(index, values, texts)


def _doubt(tokens: tuple[Token, ...]) -> str:
    """Fractions such as 1.8, 1.9, 1.10: nobody prints decimals so, but are they?"""
    fractions = [token.parts[1] for token in tokens if len(token.parts) == 2]
    shortest = min(map(len, fractions), default=0)
    odd = next((f for f in fractions if f.endswith("0") and len(f) > shortest), None)
    return "" if odd is None else odd


def _decimal(tokens: tuple[Token, ...], index: int, signed: bool) -> Column:
    signs = [token.sign if signed else "" for token in tokens]
    texts = tuple(s + ".".join(t.parts) + t.exponent for s, t in zip(signs, tokens, strict=True))
    values = tuple(-t.value if s == "-" else t.value for s, t in zip(signs, tokens, strict=True))
    return Column(index, values, texts, is_decimal=True, doubt=_doubt(tokens))


def _are_two_numbers(tokens: tuple[Token, ...]) -> bool:
    """Whether "1.0001", "1.0002" are take 1 and its frames: these have no gaps. "0.1", "0.2" are times."""
    if any(len(token.parts) != 2 or token.exponent for token in tokens) or len(tokens) < 2:
        return False
    left, right = {token.parts[0] for token in tokens}, _whole(tokens, 0, 1, False)
    widths = {len(text) for text in right.texts}
    return len(left) == 1 and right.is_gapless and (int(*left) > 0 or len(widths) > 1)


def _is_iteration(name: Name, index: int) -> bool:
    """Whether the number is that of a folder of its own, of a training iteration."""
    token = name.tokens[index]
    after = name.tokens[index + 1].before if index + 1 < len(name.tokens) else name.after
    _, slash, start = token.before.rpartition("/")
    is_whole_part = after.startswith("/") and (bool(slash) or not index)
    return is_whole_part and ITERATION.fullmatch(start + token.text) is not None


def columns(names: list[Name]) -> list[Column]:
    """The numbers of names that are built alike (one of `groups`), place by place."""
    found: list[Column] = []
    for index, tokens in enumerate(zip(*(name.tokens for name in names), strict=True)):
        signed = _is_signed(tokens)
        parts = len(tokens[0].parts)
        if parts > 2 or _are_two_numbers(tokens):
            found += [_whole(tokens, index, part, signed and not part) for part in range(parts)]
        elif any(token.is_fractional for token in tokens):
            found.append(_decimal(tokens, index, signed))
        elif _is_iteration(names[0], index):
            found.append(replace(_whole(tokens, index, 0, False), is_iteration=True))
        else:
            found.append(_whole(tokens, index, 0, signed))
    return found
