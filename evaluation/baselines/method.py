"""What every method of the comparison is: PLY frames -> files -> PLY frames, at named operating points.

A baseline is a module of this package with a `METHOD`. The benchmark runs both directions in fresh processes:

    python -m evaluation.baselines encode METHOD SETTING FRAMES_DIR TARGET_DIR
    python -m evaluation.baselines decode METHOD TARGET_DIR FRAMES_DIR
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


class MethodUnavailable(RuntimeError):
    """A package or program is not installed, or not in the pinned version; says what to install."""


class MethodRefused(RuntimeError):
    """The method cannot hold this content (SH degree, range); the message is quoted in the results."""


@dataclass(frozen=True)
class SequenceFacts:
    """What decides whether a method can be asked at all."""

    num_frames: int
    num_gaussians: tuple[int, ...]
    sh_degree: int

    @property
    def constant_count(self) -> bool:
        """Whether N is the same in all frames."""
        return len(set(self.num_gaussians)) == 1


@dataclass(frozen=True)
class Method:
    """A codec of others, or an obvious construction, behind two functions on folders.

    name      identifier on the command line and in the results
    label     name in charts
    settings  operating points from the finest to the coarsest; one for a method without any choice
    version   version of everything that decides its bytes; raises MethodUnavailable
    accepts   None, or why this content is not for it (before anything is run)
    encode    (frames folder, empty target folder, setting): frame_0000.ply ... -> files; all count as bytes
    decode    (target folder, empty frames folder): files -> frame_0000.ply ...
    sample    None, or how many frames it is measured on: for a method that codes frames alone, and slowly
    """

    name: str
    label: str
    settings: tuple[str, ...]
    version: Callable[[], str]
    accepts: Callable[[SequenceFacts], str | None]
    encode: Callable[[Path, Path, str], None]
    decode: Callable[[Path, Path], None]
    sample: int | None = None


def frame_paths(folder: Path) -> list[Path]:
    """The frames of a folder in order."""
    return sorted(folder.glob("frame_*.ply"))


def frame_path(folder: Path, index: int) -> Path:
    """Where frame `index` goes."""
    return folder / f"frame_{index:04d}.ply"
