"""The library's front door: what the command line does, as functions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dfcgs_codec.bitstream.constants import IntraKind
from dfcgs_codec.codec.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.codec.limits import DecoderLimits
from dfcgs_codec.encoder.encoder import Progress, encode_frames
from dfcgs_codec.encoder.options import EncoderOptions
from dfcgs_codec.encoder.report import EncodeReport
from dfcgs_codec.files import check_file_target
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource, MemorySource, open_folder

#: a folder of PLY files, frames in memory, or a source that reads them when they are needed
Frames = Path | str | list[GaussianCloud] | tuple[GaussianCloud, ...] | FrameSource


def _source(frames: Frames, options: EncoderOptions) -> FrameSource:
    if isinstance(frames, (str, Path)):
        return open_folder(Path(frames))
    if isinstance(frames, (list, tuple)):
        return MemorySource(list(frames), keep_bits=options.intra == IntraKind.PLY)
    return frames


def encode_sequence(
    frames: Frames,
    target: Path | str,
    options: EncoderOptions | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> EncodeReport:
    """Encode frames into the file `target`.

    `frames` is a folder of PLY files, a list of GaussianClouds, or a FrameSource such as
    `dfcgs_codec.sequence.open_folder` returns. `progress(done, total)` is called from time to time.
    The file appears under its name only when it is whole; an existing one is kept unless `force`.
    Raises InputError for input that cannot be coded or a bound that cannot be kept.
    """
    check_file_target(Path(target), force=force)
    options = options or EncoderOptions()
    return encode_frames(_source(frames, options), Path(target), options, force=force, progress=progress)


def decode_sequence(
    path: Path | str,
    start: int = 0,
    stop: int | None = None,
    *,
    check: bool = True,
    limits: DecoderLimits | None = None,
) -> Iterator[DecodedFrame]:
    """Frames start..stop - 1 of the file at `path`, one after the other; `frame.cloud()` has the values.

    Raises BitstreamError for a file that is refused, ResourceLimit among them for one that asks for more
    memory or work than `limits` (DecoderLimits(): 2 GiB), and, with `check`, VerificationError where a
    frame's hash is not the encoder's.
    """
    with Path(path).open("rb") as file:
        yield from SequenceDecoder(file, check=check, limits=limits).frames(start, stop)
