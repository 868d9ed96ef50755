"""SPZ version 4, a file per frame: what publishing a sequence costs today. Precision is fixed by the format.

It loses what `evaluation.baselines.spz` lists: scales below exp(-10) and SH outside +-1 are clamped, SH are 5
and 4 bits. Positions beyond +-2048 scene units are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dfcgs_codec.gaussians import GaussianCloud
from evaluation.baselines import spz
from evaluation.baselines.frames import pinned, write_frames
from evaluation.baselines.method import (
    Method,
    MethodRefused,
    MethodUnavailable,
    SequenceFacts,
    frame_paths,
)

_WRAPPER = 1


def version() -> str:
    """Package, version of the format, and of this wrapper."""
    return f"{pinned(spz.REQUIREMENT)} SPZ {spz.SPZ_VERSION} wrapper {_WRAPPER}"


def accepts(facts: SequenceFacts) -> str | None:
    """Everything."""
    del facts
    return None


def encode_ply(ply_path: Path, spz_path: Path) -> None:
    """As `spz.encode_ply`, with the errors of a method."""
    try:
        spz.encode_ply(ply_path, spz_path)
    except spz.BaselineUnavailable as error:
        raise MethodUnavailable(str(error)) from error
    except spz.BaselineError as error:
        raise MethodRefused(str(error)) from error


def _encode(frames: Path, target: Path, setting: str) -> None:
    del setting
    for index, path in enumerate(frame_paths(frames)):
        encode_ply(path, target / f"frame_{index:04d}.spz")


def _clouds(target: Path) -> Iterator[GaussianCloud]:
    for path in sorted(target.glob("frame_*.spz")):
        yield spz.decode(path)


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds(target))


METHOD = Method("spz", "SPZ per frame", ("v4",), version, accepts, _encode, _decode)
