"""The front door: a frame in any format that is read, by the name and the first bytes of its file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply.compressed import is_compressed_ply
from dfcgs_codec.ply.foreign import (
    Foreign,
    load_foreign,
    peek_compressed,
    peek_splat,
    peek_spz,
)
from dfcgs_codec.ply.formats import FRAME_SUFFIXES, describe_foreign
from dfcgs_codec.ply.header import Header, read_header
from dfcgs_codec.ply.policy import InputPolicy, PlyHeader
from dfcgs_codec.ply.read import load_ply, open_frame, peek_ply


def peek_header(path: Path, policy: InputPolicy | None = None) -> PlyHeader:
    """What header and size of the frame in `path` tell, read with one look at the start of the file.

    InputError for all that they tell and `policy` does not allow: missing, unknown and repeated properties,
    other elements, a file shorter or longer than its header says, other formats without a reader.
    """
    policy = policy or InputPolicy()
    with _opened(path, policy) as (file, found):
        return found.header if isinstance(found, Foreign) else peek_ply(file, found, path, policy)[1]


def read_ply(path: Path, policy: InputPolicy | None = None) -> tuple[GaussianCloud, list[str]]:
    """The frame in `path`, and notes about what was repaired or left out of the values.

    Arrays are float32, or float64 where one of their properties is a double or an int. InputError as from
    `peek_header`, and for values that are not finite and zero quaternions, unless `policy` says otherwise.
    """
    policy = policy or InputPolicy()
    with _opened(path, policy) as (file, found):
        if isinstance(found, Foreign):
            return load_foreign(file, found, path, policy)
        return load_ply(file, found, path, policy)


@contextmanager
def _opened(path: Path, policy: InputPolicy) -> Iterator[tuple[BinaryIO, Header | Foreign]]:
    with open_frame(path) as file:
        try:
            yield file, _looked_at(file, path, policy)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _looked_at(file: BinaryIO, path: Path, policy: InputPolicy) -> Header | Foreign:
    suffix = path.suffix.lower()
    if suffix == ".splat":
        return peek_splat(file, path)
    if suffix == ".spz":
        return peek_spz(file, path)
    what = describe_foreign(path) if suffix not in FRAME_SUFFIXES else None
    if what:
        raise InputError(f"{path}: {what}")
    header = read_header(file, path)
    if is_compressed_ply(header):
        return peek_compressed(file, header, path, policy)
    return header
