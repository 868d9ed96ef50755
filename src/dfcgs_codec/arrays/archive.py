"""An .npz whose arrays are read a timestep at a time, never whole and never mapped.

What `np.savez` wrote is read at its place in the file. What `np.savez_compressed` wrote is unpacked from
the start; the stream stays open, so that timesteps in their order are unpacked once. Pickles are never
loaded.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy

from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.errors import InputError
from dfcgs_codec.ply.formats import describe_content

_ENDING = ".npy"
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
#: signature to lengths of name and extra field of the header before each member
_LOCAL_HEADER = 30
#: deflate cannot pack zeros more tightly than this
_MOST_PACKED = 1040
_ENCRYPTED = 1
_SNIFFED = 512
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError)


class Stamp(NamedTuple):
    """What tells that a file was changed."""

    size: int
    modified_ns: int

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """Of the file at `path`."""
        status = path.stat()
        return cls(status.st_size, status.st_mtime_ns)


@dataclass(frozen=True)
class Member:
    """An array of the file: `start` is where its values begin in `name`.npy or, if `stored`, in the file."""

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    by_column: bool
    stored: bool
    start: int


@dataclass
class Archive:
    """The arrays of the .npz at `path` by name; threads may read at once, other processes open it anew."""

    path: Path
    members: dict[str, Member]
    stamp: Stamp
    _streams: dict[str, IO[bytes]] = field(default_factory=dict, repr=False)
    _lock: Lock = field(default_factory=Lock, repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return Archive, (self.path, self.members, self.stamp)

    def check_unchanged(self) -> None:
        """InputError where the file is another than the one that was opened."""
        with _refused(self.path):
            if Stamp.of(self.path) == self.stamp:
                return
        raise InputError(
            f"{self.path}: the file was changed since the encode began; encode again when it is finished"
        )

    def read(self, name: str, index: int | None = None) -> AnyArray:
        """Array `name`, or of its first axis the part `index`, as a new array in this machine's byte order.

        InputError where the file ends early or is damaged.
        """
        member = self.members[name]
        shape = member.shape if index is None else member.shape[1:]
        values = np.empty(shape, member.dtype, order="F" if member.by_column else "C")
        with _refused(self.path):
            self._fill(member, values, (index or 0) * values.nbytes)
        return values.astype(member.dtype.newbyteorder("="), copy=False)

    def _fill(self, member: Member, values: AnyArray, offset: int) -> None:
        if not values.nbytes:
            return
        target = values.ravel(order="K").view(np.uint8).data
        if member.stored:
            with self.path.open("rb") as file:
                _read_into(file, member.start + offset, target)
        else:
            with self._lock:
                _read_into(self._stream(member), member.start + offset, target)

    def _stream(self, member: Member) -> IO[bytes]:
        """The unpacked bytes of an array, where the last read left them."""
        if member.name not in self._streams:
            archive = zipfile.ZipFile(self.path)
            self._streams[member.name] = archive.open(member.name + _ENDING)
        return self._streams[member.name]


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Whatever a damaged file raises in a library, as an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except _DAMAGE as error:
        reason = str(error) or type(error).__name__
        raise InputError(f"{path}: damaged or truncated ({reason}); copy or save it again") from None


def _read_into(file: IO[bytes], start: int, target: memoryview) -> None:
    file.seek(start)
    done = 0
    while done < len(target):
        part = file.read(len(target) - done)
        if not part:
            raise EOFError("it ends early")
        target[done : done + len(part)] = part
        done += len(part)


def open_archive(path: Path) -> Archive:
    """The arrays of the .npz at `path`, known from their headers; InputError for any other file.

    Arrays of Python objects are refused: they are pickles, which can run a program when they are loaded.
    """
    with _refused(path):
        stamp = Stamp.of(path)
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                found = describe_content(file.read(_SNIFFED))
                found = found if found.startswith("it is ") else "it is no zip archive"
                raise InputError(f"{path}: not an .npz file ({found}); save it with numpy.savez")
            with zipfile.ZipFile(file) as archive:
                members = [
                    _member(archive, info, file, path)
                    for info in archive.infolist()
                    if info.filename.endswith(_ENDING)
                ]
    return Archive(path, {member.name: member for member in members}, stamp)


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, file: IO[bytes], path: Path) -> Member:
    name = info.filename.removesuffix(_ENDING)
    if info.flag_bits & _ENCRYPTED or info.compress_type not in _PACKINGS:
        raise InputError(f"{path}: {name} is packed in a way that numpy.savez does not; save it again")
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        if version not in _HEADERS:
            raise InputError(f"{path}: {name} is no array of numbers; save it again with numpy.savez")
        shape, by_column, dtype = _HEADERS[version](stream)
        start = stream.tell()
    if dtype.hasobject:
        raise InputError(
            f"{path}: {name} holds Python objects (a pickle), expected an array of numbers; save "
            "it again as one"
        )
    size = start + int(np.prod(shape, dtype=object)) * dtype.itemsize
    if size != info.file_size or size > _MOST_PACKED * (info.compress_size + 1):
        raise InputError(
            f"{path}: {name} holds {info.file_size} bytes, expected {size} for {dtype} {shape}; save it again"
        )
    stored = info.compress_type == zipfile.ZIP_STORED
    if stored:
        start += _data_start(file, info)
    return Member(name, dtype, shape, by_column, stored, start)


def _data_start(file: IO[bytes], info: zipfile.ZipInfo) -> int:
    """Where the bytes of a member begin, after the header before them."""
    file.seek(info.header_offset + _LOCAL_HEADER - 4)
    lengths = file.read(4)
    return (
        info.header_offset
        + _LOCAL_HEADER
        + int.from_bytes(lengths[:2], "little")
        + int.from_bytes(lengths[2:], "little")
    )
