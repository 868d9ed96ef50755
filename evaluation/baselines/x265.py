"""Grey 12-bit images through libx265 by way of the ffmpeg program: a bare HEVC stream per video."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import UInt16
from evaluation.baselines.method import MethodRefused, MethodUnavailable

#: what serves pictures only is off: psycho-visual weights, filters across edges, adaptive quantisation;
#: transform skip and RDOQ, beyond the preset, pay on sparse noise.
#: One frame at a time, so that bytes do not depend on the number of cores
_PARAMETERS = (
    "log-level=info:info=0:frame-threads=1:keyint=60:open-gop=0:scenecut=0:"
    "psy-rd=0:psy-rdoq=0:aq-mode=0:cutree=0:no-deblock=1:sao=0:no-strong-intra-smoothing=1:"
    "tskip=1:rdoq-level=1"
)
_PIXELS = "gray12le"


def _ffmpeg() -> str:
    program = shutil.which("ffmpeg")
    if program is None:
        raise MethodUnavailable("ffmpeg with libx265 is missing: install your system's ffmpeg package")
    return program


def _input(shape: tuple[int, int]) -> list[str]:
    height, width = shape
    return ["-f", "rawvideo", "-pix_fmt", _PIXELS, "-s", f"{width}x{height}", "-r", "30", "-i", "-"]


def _encode(images: Iterable[UInt16], shape: tuple[int, int], rate: str) -> tuple[bytes, str]:
    """The stream and what the encoder said."""
    coder = ["-c:v", "libx265", "-preset", "medium", "-x265-params", f"{rate}:{_PARAMETERS}"]
    command = [_ffmpeg(), "-hide_banner", *_input(shape), *coder, "-f", "hevc", "-"]
    raw = b"".join(image.astype("<u2").tobytes() for image in images)
    done = subprocess.run(command, input=raw, capture_output=True, check=False)
    text = done.stderr.decode("utf-8", "replace")
    if done.returncode:
        raise MethodRefused(f"ffmpeg cannot encode {shape[1]} x {shape[0]} as 12-bit HEVC: {text[-300:]}")
    return done.stdout, text


def encode(path: Path, images: Iterable[UInt16], shape: tuple[int, int], rate: str) -> None:
    """Write images of one shape (height, width) as HEVC; `rate` is "qp=.." or "lossless=1"."""
    path.write_bytes(_encode(images, shape, rate)[0])


def decode(path: Path, shape: tuple[int, int]) -> Iterator[UInt16]:
    """The images of a stream."""
    command = [_ffmpeg(), "-v", "error", "-f", "hevc", "-i", str(path), "-fps_mode", "passthrough"]
    command += ["-f", "rawvideo", "-pix_fmt", _PIXELS, "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    yield from np.frombuffer(raw, "<u2").reshape(-1, *shape)


def version() -> str:
    """Versions of libx265 and of the program that calls it, neither of which can be pinned."""
    try:
        _, text = _encode([np.zeros((64, 64), np.uint16)], (64, 64), "lossless=1")
    except MethodRefused as error:
        raise MethodUnavailable(f"{error}; install an ffmpeg with libx265 of 12 bits") from error
    library = re.search(r"HEVC encoder version (\S+)", text)
    banner = subprocess.run([_ffmpeg(), "-version"], capture_output=True, text=True, check=True).stdout
    return f"x265 {library.group(1) if library else 'unknown'}, ffmpeg {banner.split()[2]}"
