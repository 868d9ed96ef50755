"""Folders of PLY frames <-> ordered frame sources."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import InputPolicy, PlyHeader, peek_header, read_ply

DEFAULT_PATTERN = "*.ply"
_MAX_NUMBER = (1 << 32) - 1
_NUMBER = re.compile(r"\d+")


class FrameSource(Protocol):
    """Frames that can be read one at a time, in any order, by any process."""

    @property
    def numbers(self) -> list[int]:
        """Frame numbers, strictly ascending."""
        ...

    @property
    def headers(self) -> list[PlyHeader]:
        """Gaussians and SH degree of each frame, known without reading the frames."""
        ...

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """Frame `index` (0 is the first) and notes about repairs."""
        ...


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
        if len({frame.sh_degree for frame in self.frames}) > 1:
            raise InputError("frames of different SH degree; a sequence has one SH degree")

    @property
    def numbers(self) -> list[int]:
        """0, 1, 2, ..."""
        return list(range(len(self.frames)))

    @property
    def headers(self) -> list[PlyHeader]:
        """See FrameSource."""
        return [PlyHeader(frame.num_gaussians, frame.sh_degree) for frame in self.frames]

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """See FrameSource."""
        return self.frames[index], []


@dataclass(frozen=True)
class FolderSource:
    """PLY files, read when asked for."""

    paths: list[Path]
    numbers: list[int]
    headers: list[PlyHeader]
    policy: InputPolicy

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """See FrameSource."""
        return read_ply(self.paths[index], self.policy)


def _frame_numbers(paths: list[Path], folder: Path) -> list[int]:
    """The number in each path that tells the frames apart: the only group of digits that varies."""
    groups = [[int(g) for g in _NUMBER.findall(str(path.relative_to(folder)))] for path in paths]
    if len(paths) == 1:
        return [groups[0][-1] if groups[0] else 0]
    if len({len(g) for g in groups}) != 1 or not groups[0]:
        raise InputError(
            f"{folder}: file names do not share one numbering ({paths[0].name}, {paths[-1].name}); "
            "name frames like frame_0000.ply or choose them with --pattern"
        )
    varying = [i for i, column in enumerate(zip(*groups, strict=True)) if len(set(column)) == len(paths)]
    if not varying:
        raise InputError(f"{folder}: two files have the same frame number; choose frames with --pattern")
    return [g[varying[0]] for g in groups]


def _check_numbers(paths: list[Path], numbers: list[int]) -> None:
    if numbers[-1] > _MAX_NUMBER:
        raise InputError(f"{paths[-1]}: frame number {numbers[-1]} is above {_MAX_NUMBER}; rename the frames")


def _check_gaps(paths: list[Path], numbers: list[int], folder: Path) -> None:
    for before, after in itertools.pairwise(numbers):
        if after != before + 1:
            raise InputError(
                f"{folder}: frames {before + 1} to {after - 1} are missing "
                f"(after {paths[numbers.index(before)].name}); "
                "--allow-gaps encodes the others and keeps their numbers"
            )


def open_folder(
    folder: Path,
    pattern: str = DEFAULT_PATTERN,
    *,
    allow_gaps: bool = False,
    policy: InputPolicy | None = None,
) -> FolderSource:
    """Frames of `folder` that match `pattern` (a glob, may contain '/'), in the order of their numbers.

    InputError for no frames, doubtful or missing numbers (unless `allow_gaps`), and mixed SH degrees.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: not a folder; expected one PLY file per frame in it")
    try:
        found = sorted(path for path in folder.glob(pattern) if path.is_file())
    except (ValueError, NotImplementedError) as error:
        raise InputError(
            f"{folder}: --pattern {pattern!r}: {error}; it is a relative glob such as '*.ply'"
        ) from None
    if not found:
        raise InputError(f"{folder}: no file matches '{pattern}'; --pattern chooses other names")
    order = sorted(zip(_frame_numbers(found, folder), found, strict=True))
    numbers, paths = [n for n, _ in order], [p for _, p in order]
    _check_numbers(paths, numbers)
    if not allow_gaps:
        _check_gaps(paths, numbers, folder)
    headers = [peek_header(path) for path in paths]
    for path, header in zip(paths, headers, strict=True):
        if header.sh_degree != headers[0].sh_degree:
            raise InputError(
                f"{path}: SH degree {header.sh_degree}, but {paths[0].name} has {headers[0].sh_degree}; "
                "a sequence has one SH degree"
            )
    return FolderSource(paths, numbers, headers, policy or InputPolicy())
