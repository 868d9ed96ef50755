"""The rows of element vertex, as the arrays that a layout asks for; read, never mapped.

A file that another program shortens while it is read gives a refusal: a mapped one would end the process.
"""

from __future__ import annotations

import io
import itertools
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from plyfile import PlyData

from dfcgs_codec.array_types import AnyArray, Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.ply.header import Element, Header, readable
from dfcgs_codec.ply.schema import Layout

Columns = dict[str, AnyArray]

#: rows are copied to their arrays in blocks that stay in the cache
_BLOCK_BYTES = 1 << 19
#: integers of these types need a double to be kept exactly
_WIDE = ("f8", "i4", "u4")
#: NaN and infinity as old C runtimes of Windows print them
_MSVC = re.compile(rb"([+-]?)1\.#(INF|QNAN|SNAN|IND)[0-9]*", re.IGNORECASE)
_NAN = re.compile(rb"nan\(\w*\)", re.IGNORECASE)
_COMMA = re.compile(rb"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)


def least_bytes(header: Header) -> int:
    """The least that a body with this header takes; exact for a binary body without lists."""
    total = 0
    for element in header.elements:
        row = element.row_bytes if header.byte_order else 2 * len(element.properties)
        total += element.count * row
    return max(total if header.byte_order else total - 1, 0)


def exact_bytes(header: Header) -> int | None:
    """The size of a binary body without lists, else None."""
    fixed = header.byte_order and not any(e.has_lists and e.count for e in header.elements)
    return least_bytes(header) if fixed else None


def read_columns(
    file: BinaryIO, header: Header, layout: Layout, path: Path, *, trailing: bool = False
) -> tuple[Columns, int]:
    """For each attribute of `layout` an array (N, number of its properties).

    It is float64 where one of them is a double or has 32-bit integers, else float32.
    `file` is at the start of the body. InputError if it ends early or holds what is not a number. Lines of an
    ascii body after the last row are refused unless `trailing`; also returns how many there are.
    """
    vertex = header.vertex
    kinds = {p.name: p.kind for p in vertex.properties}
    columns: Columns = {
        key: np.empty((vertex.count, len(names)), "f8" if any(kinds[n] in _WIDE for n in names) else "f4")
        for key, names in layout.columns.items()
    }
    if any(e.has_lists for e in (*header.before_vertex, vertex)):
        _read_lists(file, header, layout, columns, path)
    elif header.byte_order:
        _read_binary(file, header, layout, columns, path)
    else:
        return columns, _read_ascii(file, header, layout, columns, path, trailing)
    return columns, 0


def ends_early(path: Path, count: int, missing: int) -> InputError:
    """The refusal of a file that is shorter than its header says."""
    return InputError(
        f"{path}: truncated: the file ends {missing} bytes before the end of the {count} Gaussians that its "
        "header announces; copy or export the frame again"
    )


class _Run(NamedTuple):
    """Properties of one type that are neighbours in a row and in an array."""

    target: AnyArray
    first: int
    offset: int
    dtype: np.dtype[Any]
    length: int


def _runs(header: Header, layout: Layout, columns: Columns) -> Iterator[_Run]:
    vertex = header.vertex
    offsets = dict(
        zip(
            (p.name for p in vertex.properties),
            itertools.accumulate((p.num_bytes for p in vertex.properties), initial=0),
            strict=False,
        )
    )
    dtypes = {p.name: np.dtype(header.dtype(p)) for p in vertex.properties}
    for key, names in layout.columns.items():
        first = 0
        while first < len(names):
            dtype, offset, length = dtypes[names[first]], offsets[names[first]], 1
            while (
                first + length < len(names)
                and dtypes[names[first + length]] == dtype
                and offsets[names[first + length]] == offset + length * dtype.itemsize
            ):
                length += 1
            yield _Run(columns[key], first, offset, dtype, length)
            first += length


def _read_binary(file: BinaryIO, header: Header, layout: Layout, columns: Columns, path: Path) -> None:
    vertex = header.vertex
    file.seek(sum(e.count * e.row_bytes for e in header.before_vertex), io.SEEK_CUR)
    row = vertex.row_bytes
    block_rows = max(1, _BLOCK_BYTES // row)
    buffer = bytearray(row * min(block_rows, vertex.count))
    runs = list(_runs(header, layout, columns))
    for start in range(0, vertex.count, block_rows):
        rows = min(block_rows, vertex.count - start)
        found = _fill(file, memoryview(buffer)[: rows * row])
        if found < rows * row:
            raise ends_early(path, vertex.count, (vertex.count - start) * row - found)
        for run in runs:
            source = np.ndarray((rows, run.length), run.dtype, buffer, run.offset, (row, run.dtype.itemsize))
            run.target[start : start + rows, run.first : run.first + run.length] = source


def _fill(file: BinaryIO, view: memoryview) -> int:
    done = 0
    while done < len(view):
        count = file.readinto(view[done:])  # type: ignore[attr-defined]
        if not count:
            break
        done += count
    return done


def _assign(columns: Columns, layout: Layout, table: dict[str, AnyArray]) -> None:
    for key, names in layout.columns.items():
        for index, name in enumerate(names):
            # a double that float32 has no room for becomes infinite, as it does for every reader
            with np.errstate(over="ignore", invalid="ignore"):
                columns[key][:, index] = table[name]


# --- ascii --------------------------------------------------------------------------------------------


def _text(file: BinaryIO) -> bytes:
    """The rest of the file with LF as line end, and NaN and infinity as Python knows them."""
    text = file.read()
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"#" in text:
        text = _MSVC.sub(lambda found: found[1] + (b"inf" if found[2].upper() == b"INF" else b"nan"), text)
    return _NAN.sub(b"nan", text) if b"(" in text else text


def _read_ascii(
    file: BinaryIO, header: Header, layout: Layout, columns: Columns, path: Path, trailing: bool
) -> int:
    lines = [line for line in _text(file).split(b"\n") if line and not line.isspace()]
    vertex = header.vertex
    start = sum(e.count for e in header.before_vertex)
    rows = lines[start : start + vertex.count]
    if len(rows) < vertex.count:
        raise InputError(
            f"{path}: truncated: {len(rows)} of {vertex.count} Gaussians are there; "
            "copy or export the frame again"
        )
    table = _numbers(rows, vertex, path)
    _assign(columns, layout, {p.name: table[:, i] for i, p in enumerate(vertex.properties)})
    extra = len(lines) - sum(e.count for e in header.elements)
    if extra > 0 and not trailing and not any(e.has_lists for e in header.elements):
        raise InputError(
            f"{path}: {extra} more lines than the header announces; export the frame again, or: "
            "--drop-extra leaves them out"
        )
    return max(extra, 0)


def _numbers(rows: list[bytes], vertex: Element, path: Path) -> Float64:
    """The table (rows, properties) of lines of numbers."""
    width = len(vertex.properties)
    table = np.empty((len(rows), width))
    for index, row in enumerate(rows):
        words = row.split()
        if len(words) != width:
            raise InputError(
                f"{path}: Gaussian {index} has {len(words)} values, expected {width}: '{readable(row)}'; "
                "export the frame again"
            )
        try:
            table[index] = list(map(float, words))
        except ValueError:
            raise _no_number(words, index, path) from None
    return table


def _no_number(words: list[bytes], index: int, path: Path) -> InputError:
    bad = next(word for word in words if not _is_number(word))
    comma = ": a decimal comma" if _COMMA.fullmatch(bad) else ""
    return InputError(
        f"{path}: '{readable(bad)}' of Gaussian {index} is no number{comma}; export the frame again"
    )


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# --- rows of different sizes --------------------------------------------------------------------------


def _read_lists(file: BinaryIO, header: Header, layout: Layout, columns: Columns, path: Path) -> None:
    body = file.read() if header.byte_order else _text(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = PlyData.read(io.BytesIO(_clean_header(header) + body))["vertex"].data
    except Exception as error:  # whatever a stranger's bytes raise in a library is a refusal of the file
        reason = readable(str(error).encode()) or type(error).__name__
        raise InputError(
            f"{path}: damaged or truncated PLY ({reason}); copy or export the frame again"
        ) from None
    names = {p.name: f"p{i}" for i, p in enumerate(header.vertex.properties)}
    wanted = {name for names in layout.columns.values() for name in names}
    _assign(columns, layout, {name: table[names[name]] for name in wanted})


def _clean_header(header: Header) -> bytes:
    order = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[header.byte_order]
    lines = ["ply", f"format {order} 1.0"]
    for number, element in enumerate((*header.before_vertex, header.vertex)):
        lines.append(f"element {'vertex' if element.name == 'vertex' else f'e{number}'} {element.count}")
        for i, item in enumerate(element.properties):
            length = f"list {item.length_kind} " if item.length_kind else ""
            lines.append(f"property {length}{item.kind} p{i}")
    return "\n".join([*lines, "end_header", ""]).encode()
