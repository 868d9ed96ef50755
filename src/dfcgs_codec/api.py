"""The library's front door: what the command line does, as functions.

Arguments may be what a Python user passes by habit; anything else is refused by an InputError that says what
was expected, before anything is read or written.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dfcgs_codec.arguments import AnyPath, path_of, refusal, switch, whole
from dfcgs_codec.bitstream.constants import MAGIC, IntraKind
from dfcgs_codec.codec.frame.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.codec.frame.limits import DecoderLimits
from dfcgs_codec.core.engine import ENGINES
from dfcgs_codec.encoder.frame.encoder import Progress, encode_frames
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.errors import InputError
from dfcgs_codec.files import check_file_target
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import InputPolicy
from dfcgs_codec.sequence import FrameSource, MemorySource, open_frames
from dfcgs_codec.spelling import spelled

#: a folder of PLY files, such files, frames in memory or made one after the other, or a source of them
Frames = AnyPath | GaussianCloud | Iterable[GaussianCloud] | Iterable[AnyPath] | FrameSource

_FRAMES = "a folder of PLY files, GaussianClouds in their order, or a source such as open_folder() gives"
_PATHS = (str, bytes, os.PathLike)
_SOURCE = ("numbers", "headers", "read")


def _source(frames: Frames, keep_bits: bool) -> FrameSource:
    if isinstance(frames, GaussianCloud):
        return MemorySource([frames], keep_bits=keep_bits)
    if all(hasattr(frames, name) for name in _SOURCE):
        return _checked_source(frames)  # type: ignore[arg-type]
    # a set has no order, a dict of arrays is no sequence
    if isinstance(frames, (*_PATHS, Set, Mapping)) or not isinstance(frames, Iterable):
        return open_frames([path_of("frames", frames, _FRAMES)], policy=InputPolicy(keep_bits=keep_bits))
    listed = list(_listed(frames))
    paths = [frame for frame in listed if not isinstance(frame, GaussianCloud)]
    if paths and len(paths) == len(listed):
        return open_frames(paths, policy=InputPolicy(keep_bits=keep_bits))
    if paths:
        raise InputError(f"frames: a GaussianCloud and a file ({paths[0]}), expected all of one kind")
    return MemorySource([frame for frame in listed if isinstance(frame, GaussianCloud)], keep_bits=keep_bits)


def _listed(frames: Iterable[object]) -> Iterator[GaussianCloud | Path]:
    """Each frame; of an iterator a copy: it may fill the same arrays again."""
    for index, frame in enumerate(frames):
        if isinstance(frame, GaussianCloud):
            whole_frame = np.arange(frame.num_gaussians)
            yield frame.take(whole_frame) if isinstance(frames, Iterator) else frame
        elif isinstance(frame, _PATHS):
            yield path_of(f"frame {index}", frame, _FRAMES)
        elif isinstance(frame, DecodedFrame):
            raise InputError(f"frame {index}: a DecodedFrame, expected a GaussianCloud: its cloud() is one")
        else:
            raise InputError(f"frame {index}: a {type(frame).__name__}, expected a GaussianCloud")


def _checked_source(source: FrameSource) -> FrameSource:
    numbers, headers = list(source.numbers), list(source.headers)
    if len(numbers) != len(headers):
        raise InputError(
            f"frames: a source of {len(numbers)} numbers and {len(headers)} headers, expected as many"
        )
    if any(b <= a for a, b in pairwise([-1, *numbers])):
        raise InputError("frames: a source whose numbers do not ascend from 0 or more; sort its frames")
    return source


def encode_sequence(
    frames: Frames,
    target: AnyPath,
    options: EncoderOptions | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> EncodeReport:
    """Encode frames into the file `target`.

    `frames` is a folder of PLY files, the files, or the params.npz of Dynamic 3D Gaussians; GaussianClouds in
    a list, a tuple or any iterable, which is gone through once, into memory, before the work begins; a
    GaussianCloud, as a sequence of one frame; or a FrameSource such as `open_folder` returns. Arrays must
    stay as they are until the end.
    `progress(done, total)` is called from time to time.
    The file appears under its name only when it is whole; an existing one is kept unless `force`.
    Raises InputError for input that cannot be coded or a bound that cannot be kept.
    """
    path = path_of("target", target, "the path of a file")
    if options is not None and not isinstance(options, EncoderOptions):
        raise refusal("options", options, "EncoderOptions(...)")
    if progress is not None and not callable(progress):
        raise refusal("progress", progress, "a function (done, total)")
    replace = switch("force", force)
    check_file_target(path, force=replace)
    options = options or EncoderOptions()
    source = _source(frames, options.intra == IntraKind.PLY)
    report = encode_frames(source, path, options, force=replace, progress=progress)
    report.notes = [spelled(note) for note in report.notes]
    return report


def _index(name: str, value: object) -> int:
    """A number of frames from the first."""
    expected = "a whole number from 0; frames are counted from the first"
    number = whole(name, value, expected)
    if number < 0:
        raise refusal(name, value, expected)
    return number


@contextmanager
def _opened(path: Path | BinaryIO) -> Iterator[BinaryIO]:
    """The file at `path`, or the open file that it is, which stays open."""
    if isinstance(path, Path):
        with path.open("rb") as file:
            yield file
    else:
        yield path


def _file(path: AnyPath | BinaryIO) -> Path | BinaryIO:
    if isinstance(path, bytes) and path.startswith(MAGIC):
        raise InputError("path: found the bytes of a .dgs file, expected its path or io.BytesIO(bytes)")
    if isinstance(path, _PATHS) or not hasattr(path, "read"):
        return path_of("path", path, "the path of a .dgs file, or the file open for reading bytes")
    if not isinstance(path.read(0), bytes) or not path.seekable():
        raise InputError("path: found a pipe or a file open as text, expected one of bytes that can seek")
    return path


def _decoded(file: Path | BinaryIO, frames: tuple[int, int | None], **how: Any) -> Iterator[DecodedFrame]:
    with _opened(file) as stream:
        yield from SequenceDecoder(stream, **how).frames(*frames)


def decode_sequence(
    path: AnyPath | BinaryIO,
    start: int = 0,
    stop: int | None = None,
    *,
    check: bool = True,
    limits: DecoderLimits | None = None,
    engine: str | None = None,
) -> Iterator[DecodedFrame]:
    """Frames start..stop - 1 of the file at `path`, one after the other; `frame.cloud()` has the values.

    `path` may be a file open for reading bytes that can seek, which stays open. As with slices, frames beyond
    the last are none. Arguments are checked at once; the file is opened when the first frame is asked for.
    `engine` is "core", the C core, or "numpy", the reference, which is slower: the frames are the same. None
    takes what the environment's DFCGS_ENGINE says, or the core where wasmtime can be imported.
    Raises InputError for arguments of other kinds, BitstreamError for a file that is refused, ResourceLimit
    among them for one that asks for more memory or work than `limits` (DecoderLimits(): 2 GiB), and, with
    `check`, VerificationError where a frame's hash is not the encoder's.
    """
    first, end = _index("start", start), None if stop is None else _index("stop", stop)
    if limits is not None and not isinstance(limits, DecoderLimits):
        raise refusal("limits", limits, "DecoderLimits(...)")
    if engine not in (None, *ENGINES):
        raise refusal("engine", engine, " or ".join(f'"{name}"' for name in ENGINES))
    how = {"check": switch("check", check), "limits": limits, "engine": engine}
    return _decoded(_file(path), (first, end), **how)
