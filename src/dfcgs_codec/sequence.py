"""Folders of PLY frames, and files of whole sequences -> ordered frame sources."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from dfcgs_codec.arrays.params import ENDING, TimestepSource, open_params, params_in
from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.choice import DEFAULT_PATTERN, frames_in, frames_named
from dfcgs_codec.frames.listing import matches
from dfcgs_codec.frames.order import BY_NUMBER, order_of
from dfcgs_codec.frames.trees import Chosen, walk
from dfcgs_codec.frames.typed import typed_frames
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.ply import InputPolicy, PlyHeader, peek_header, read_ply, said_once

__all__ = [
    "DEFAULT_PATTERN",
    "FolderSource",
    "FrameSource",
    "MemorySource",
    "TimestepSource",
    "open_folder",
    "open_frames",
]


class FrameSource(Protocol):
    """Frames that can be read one at a time, in any order, by any process."""

    @property
    def numbers(self) -> list[int]:
        """Frame numbers, strictly ascending."""

    @property
    def headers(self) -> list[PlyHeader]:
        """Gaussians and SH degree of each frame, known without reading the frames."""

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """Frame `index` (0 is the first), of the sequence's SH degree, and notes about repairs."""


def notes_of(source: FrameSource) -> list[str]:
    """What is to be said of all frames together: `source.notes`, which a source need not have."""
    return list(getattr(source, "notes", []))


def sequence_sh_degree(headers: Iterable[PlyHeader]) -> int:
    """The largest SH degree of the frames: coefficients that others lack are zero."""
    return max(header.sh_degree for header in headers)


def with_sh_degree(cloud: GaussianCloud, sh_degree: int) -> GaussianCloud:
    """The frame with zeros for the coefficients that it lacks of `sh_degree`."""
    missing = SH_REST_COEFFICIENTS[sh_degree] - cloud.sh_rest.shape[2]
    return replace(cloud, sh_rest=np.pad(cloud.sh_rest, ((0, 0), (0, 0), (0, missing)))) if missing else cloud


def padding_notes(names: list[str], headers: list[PlyHeader]) -> list[str]:
    """Which frames lack coefficients of the sequence's SH degree."""
    degree = max((header.sh_degree for header in headers), default=0)
    lower = [(n, h.sh_degree) for n, h in zip(names, headers, strict=True) if h.sh_degree < degree]
    if not lower:
        return []
    return [
        f"SH degree {degree}, but lower in {len(lower)} of {len(names)} frames (first {lower[0][0]}: "
        f"{lower[0][1]}); the coefficients that these lack are zero"
    ]


def _check_values(frame: GaussianCloud, index: int) -> None:
    """What `read_ply` checks of a file, for a frame in memory."""
    for name in ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest"):
        values = getattr(frame, name)
        if not np.isfinite(values).all():
            raise InputError(f"frame {index}: {name} holds NaN or infinite values")
    if (frame.rotations == 0).all(axis=1).any():
        raise InputError(f"frame {index}: a quaternion of rotations is zero")


@dataclass(frozen=True)
class MemorySource:
    """Frames that are in memory; `keep_bits`: values that are not finite are kept as they are."""

    frames: list[GaussianCloud]
    keep_bits: bool = False

    def __post_init__(self) -> None:
        for index, frame in enumerate(self.frames):
            if not isinstance(frame, GaussianCloud):
                raise InputError(f"frame {index}: a {type(frame).__name__}, expected a GaussianCloud")
            if not self.keep_bits:
                _check_values(frame, index)

    @property
    def numbers(self) -> list[int]:
        """0, 1, 2, ..."""
        return list(range(len(self.frames)))

    @property
    def headers(self) -> list[PlyHeader]:
        """See FrameSource."""
        return [PlyHeader(frame.num_gaussians, frame.sh_degree) for frame in self.frames]

    @property
    def notes(self) -> list[str]:
        """What is to be said of the frames."""
        return padding_notes([f"frame {index}" for index in range(len(self.frames))], self.headers)

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """See FrameSource."""
        return with_sh_degree(self.frames[index], sequence_sh_degree(self.headers)), []


@dataclass(frozen=True)
class FolderSource:
    """PLY files, read when asked for; `notes`: what is to be said of their choice and order."""

    paths: list[Path]
    numbers: list[int]
    headers: list[PlyHeader]
    policy: InputPolicy
    notes: list[str] = field(default_factory=list)

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """See FrameSource; InputError for a file that is not what its header said when it was opened."""
        cloud, notes = read_ply(self.paths[index], self.policy)
        planned = self.headers[index]
        if (cloud.num_gaussians, cloud.sh_degree) != (planned.num_gaussians, planned.sh_degree):
            raise InputError(
                f"{self.paths[index]}: {cloud.num_gaussians} Gaussians of SH degree {cloud.sh_degree}, but "
                f"{planned.num_gaussians} of SH degree {planned.sh_degree} when the encode began: the file "
                "was changed meanwhile; encode again when it is finished"
            )
        return with_sh_degree(cloud, sequence_sh_degree(self.headers)), notes


def open_folder(
    folder: Path | str,
    pattern: str = DEFAULT_PATTERN,
    *,
    allow_gaps: bool = False,
    order_by: str = BY_NUMBER,
    policy: InputPolicy | None = None,
) -> FolderSource | TimestepSource:
    """Frames of `folder` that match `pattern` (a glob, may contain '/'), in the order of their numbers.

    By default PLYs in the folder or, where it has none, those that trainers leave in its subfolders; without
    any, the timesteps of its params.npz.
    `order_by`: see `frames.order.order_of`. InputError for no frames, for doubtful or missing numbers (unless
    `allow_gaps`), and for any frame whose header is refused.
    """
    if pattern == DEFAULT_PATTERN and (params := _params_alone(Path(folder))) is not None:
        return _timesteps(params, order_by, policy)
    found = frames_in(Path(folder), pattern)
    return _opened(Path(folder), found, order_by, allow_gaps, policy)


def open_frames(
    arguments: Sequence[str | Path],
    pattern: str = DEFAULT_PATTERN,
    *,
    allow_gaps: bool = False,
    order_by: str = BY_NUMBER,
    policy: InputPolicy | None = None,
) -> FolderSource | TimestepSource:
    """What `open_folder` gives, of a folder, of PLY files, of globs of them, or of a params.npz.

    InputError also for anything else that people name for frames, with what to name instead.
    """
    typed = typed_frames(arguments)
    if isinstance(typed, Path):
        return open_folder(typed, pattern, allow_gaps=allow_gaps, order_by=order_by, policy=policy)
    if pattern != DEFAULT_PATTERN:
        raise InputError(f"--pattern {pattern!r} chooses files of a folder, but {typed[0]} is a file")
    if any(_is_arrays(path) for path in typed):
        if len(typed) > 1:
            raise InputError(
                f"{len(typed)} files ({typed[0]}, {typed[1]}...); an .npz is a sequence: name it alone"
            )
        return _timesteps(typed[0], order_by, policy)
    folder, found = frames_named(typed)
    return _opened(folder, found, order_by, allow_gaps, policy)


def _is_arrays(path: Path) -> bool:
    return path.name.lower().endswith(ENDING)


def _params_alone(folder: Path) -> Path | None:
    """The params.npz of a folder without any PLY, in it or below."""
    params = params_in(folder)
    return None if params is None or matches(folder, DEFAULT_PATTERN).names or walk(folder).names else params


def _timesteps(path: Path, order_by: str, policy: InputPolicy | None) -> TimestepSource:
    if order_by != BY_NUMBER:
        raise InputError(f"{path}: timesteps are frames in their order, which --order-by cannot change")
    return open_params(path, policy)


def _opened(
    folder: Path, found: Chosen, order_by: str, allow_gaps: bool, policy: InputPolicy | None
) -> FolderSource:
    try:
        order = order_of(found.names, order_by, allow_gaps=allow_gaps)
    except InputError as error:
        raise InputError(f"{folder}: {error}") from None
    paths = [folder / found.names[index] for index in order.index]
    headers = [peek_header(path, policy) for path in paths]
    notes = [*found.notes, *order.notes, *padding_notes([path.name for path in paths], headers)]
    notes += said_once([found.names[index] for index in order.index], headers)
    return FolderSource(paths, order.numbers, headers, policy or InputPolicy(), notes)
