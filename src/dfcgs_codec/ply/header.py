"""The header of a PLY as it is written in the wild: any length, any newline, comments in any encoding."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from dfcgs_codec.errors import InputError
from dfcgs_codec.ply.formats import describe_content

#: a header longer than this is not one; hundreds of thousands of lines fit
MAX_HEADER_BYTES = 1 << 24
_FIRST_READ = 1 << 14
_BOM = b"\xef\xbb\xbf"
_MAX_DIGITS = 20
_BYTE_ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
_TYPES = {
    **dict.fromkeys((b"char", b"int8"), "i1"),
    **dict.fromkeys((b"uchar", b"uint8"), "u1"),
    **dict.fromkeys((b"short", b"int16"), "i2"),
    **dict.fromkeys((b"ushort", b"uint16"), "u2"),
    **dict.fromkeys((b"int", b"int32"), "i4"),
    **dict.fromkeys((b"uint", b"uint32"), "u4"),
    **dict.fromkeys((b"float", b"float32"), "f4"),
    **dict.fromkeys((b"double", b"float64"), "f8"),
}


@dataclass(frozen=True)
class Property:
    """A property of an element; `length_kind` is the type of the length of a list, '' for a number."""

    name: str
    kind: str
    length_kind: str = ""

    @property
    def num_bytes(self) -> int:
        """In a binary body; of a list, the least that it takes."""
        return int(np.dtype(self.length_kind or self.kind).itemsize)


@dataclass(frozen=True)
class Element:
    """An element: its rows have these properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in size."""
        return any(p.length_kind for p in self.properties)

    @property
    def row_bytes(self) -> int:
        """Of a row in a binary body; the least where there are lists."""
        return sum(p.num_bytes for p in self.properties)


@dataclass(frozen=True)
class Header:
    """A parsed header; `body_start` counts from the start of the file, `byte_order` is '' for ascii."""

    byte_order: str
    elements: tuple[Element, ...]
    comments: tuple[bytes, ...]
    body_start: int

    @property
    def vertex(self) -> Element:
        """The element whose rows are Gaussians; `parse_header` has seen to it that there is one."""
        return next(e for e in self.elements if e.name == "vertex")

    @property
    def before_vertex(self) -> tuple[Element, ...]:
        """The elements that come first in the body."""
        return self.elements[: self.elements.index(self.vertex)]

    def dtype(self, item: Property) -> npt.DTypeLike:
        """Of a number in a binary body."""
        return self.byte_order + item.kind


def readable(data: bytes) -> str:
    """Bytes of a file for a message: at most 60 characters, none of them a control character."""
    text = data[:61].decode("utf-8", "backslashreplace")
    if len(text) <= 60 and text.isprintable():
        return text
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return text if len(text) <= 60 else text[:57] + "..."


def read_header(file: BinaryIO, path: Path) -> Header:
    """The header of the PLY open in `file`, which is then at the start of the body.

    InputError that says what was found if it is not a PLY, or its header is not whole or not understood.
    """
    data = file.read(_FIRST_READ)
    start = len(_BOM) if data.startswith(_BOM) else 0
    newline = _newline(data[start:], path)
    end = newline + rb"[ \t]*end_header[ \t]*"
    while (found := re.search(end + newline, data[start:])) is None:
        more = file.read(min(len(data), MAX_HEADER_BYTES - len(data)))
        if not more and (found := re.search(end + rb"\Z", data[start:])):
            break
        if not more:
            raise InputError(
                f"{path}: the PLY header has no end_header line in its first {len(data)} bytes: "
                "truncated or not a PLY; copy or export the frame again"
            )
        data += more
    body_start = start + found.end()
    file.seek(body_start)
    lines = re.split(newline, data[start : start + found.start()])[1:]
    return _parsed(lines, body_start, path)


def _newline(data: bytes, path: Path) -> bytes:
    """A pattern for the line ends of a file that begins with `data`: those of its first line."""
    first = re.match(rb"ply[ \t]*(\r\n|\r|\n)", data)
    if first is None:
        raise InputError(f"{path}: not a PLY file ({describe_content(data)})")
    # CR alone must not take the first byte of a binary body for the LF of a CRLF
    return rb"\r" if first[1] == b"\r" else rb"\r?\n"


def _parsed(lines: list[bytes], body_start: int, path: Path) -> Header:
    byte_order: str | None = None
    comments: list[bytes] = []
    elements: list[tuple[str, int, list[Property]]] = []
    for line in lines:
        words = line.split()
        if not words or words[0] == b"obj_info":
            continue
        if words[0] == b"comment":
            comments.append(line.lstrip()[len(b"comment ") :].rstrip(b"\r\n"))
        elif words[0] == b"format" and len(words) >= 2 and words[1] in _BYTE_ORDERS:
            byte_order = _BYTE_ORDERS[words[1]]
        elif words[0] == b"element" and len(words) == 3:
            elements.append((readable(words[1]), _count(words, path), []))
        elif words[0] == b"property" and elements and (item := _property(words)):
            elements[-1][2].append(item)
        else:
            raise InputError(f"{path}: the PLY header has a line '{readable(line)}'; export the frame again")
    if byte_order is None:
        raise InputError(f"{path}: the PLY header has no 'format' line; export the frame again")
    header = Header(
        byte_order, tuple(Element(n, c, tuple(p)) for n, c, p in elements), tuple(comments), body_start
    )
    _check_elements(header, path)
    return header


def _count(words: list[bytes], path: Path) -> int:
    if not words[2].isdigit() or len(words[2]) > _MAX_DIGITS:
        raise InputError(
            f"{path}: element {readable(words[1])} has the count '{readable(words[2])}', "
            "expected a number of rows; export the frame again"
        )
    return int(words[2])


def _property(words: list[bytes]) -> Property | None:
    if len(words) == 3 and words[1] in _TYPES:
        return Property(readable(words[2]), _TYPES[words[1]])
    if len(words) == 5 and words[1] == b"list" and words[2] in _TYPES and words[3] in _TYPES:
        return Property(readable(words[4]), _TYPES[words[3]], _TYPES[words[2]])
    return None


def _check_elements(header: Header, path: Path) -> None:
    names = [e.name for e in header.elements]
    if "vertex" not in names:
        found = f" (elements: {', '.join(names[:8])})" if names else ""
        raise InputError(f"{path}: no 'element vertex'{found}: the file holds no Gaussians")
    if names.count("vertex") > 1:
        raise InputError(f"{path}: 'element vertex' is there {names.count('vertex')} times; one is a frame")
    for element in header.elements:
        if element.count and not element.properties:
            raise InputError(
                f"{path}: element {element.name} has {element.count} rows without properties; "
                "export the frame again"
            )
