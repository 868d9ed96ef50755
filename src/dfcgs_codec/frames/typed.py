"""What people type for the frames: a folder, files, a glob, and what is meant by other things."""

from __future__ import annotations

import glob
import os
import shlex
import stat
from collections.abc import Sequence
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.foreign import describe, readable
from dfcgs_codec.frames.listing import check_is_file

_DGS_ENDING = ".dgs"
_LISTS = (".txt", ".csv", ".lst", ".list")


def _can_be_frames(path: Path) -> bool:
    """Whether the name is that of a PLY, or of an .npz, whose timesteps are frames."""
    return path.name.lower().endswith((".ply", ".npz"))


def check_arguments(frames: Sequence[str], output: str) -> None:
    """InputError where OUTPUT is one of the frames, or the two are swapped."""
    if Path(output).name.lower().endswith(".ply"):
        raise InputError(
            f"{output}: the last argument is the file to write, and a PLY is none; end with its name, "
            "such as out.dgs"
        )
    first = frames[0]
    is_other = Path(first).suffix.lower() == _DGS_ENDING or not (
        os.path.lexists(first) or glob.has_magic(first)
    )
    if len(frames) == 1 and is_other and Path(output).is_dir() and not Path(first).is_dir():
        raise InputError(
            f"{first} is not a folder of frames, but {output} is a folder: frames come first, dfcgs encode "
            f"{shlex.quote(output)} {shlex.quote(first)}"
        )


def _expanded(argument: str) -> list[Path]:
    """The path, or what the glob matches if it is one that the shell has left as it is."""
    path = Path(argument)
    if os.path.lexists(path):
        return [path]
    if glob.has_magic(argument):
        found = sorted(Path(name) for name in glob.glob(argument))
        if not found:
            raise InputError(f"{argument}: no file matches; name the folder of the frames")
        return found
    raise InputError(f"{argument} does not exist; expected a folder with one PLY file per frame")


def _not_frames(path: Path) -> InputError:
    if path.suffix.lower() == _DGS_ENDING:
        return InputError(
            f"{path} is encoded already; 'dfcgs decode {shlex.quote(str(path))} FOLDER' decodes it"
        )
    what = describe(str(path))
    if what is not None:
        return InputError(f"{path}: {what}")
    if path.suffix.lower() in _LISTS:
        return InputError(
            f"{path} is a list, not a folder of frames; name the folder, or the files themselves: "
            f"dfcgs encode $(cat {shlex.quote(str(path))}) out.dgs"
        )
    return InputError(
        f"{path} is a file, not a folder; expected a folder with one PLY file per frame, or PLYs"
    )


def _starts_like_ply(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(4).strip() == b"ply"
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _check_one(path: Path, *, alone: bool) -> bool:
    """Whether `path` is a folder; InputError for all but folders and PLYs."""
    try:
        mode = path.stat().st_mode
    except OSError:
        check_is_file(path)
        raise
    if stat.S_ISDIR(mode):
        return True
    if not stat.S_ISREG(mode):
        raise InputError(f"{path} is a pipe or a device; frames are read from a folder of PLY files")
    if not _can_be_frames(path) and not readable([path.name]) and not _starts_like_ply(path):
        if alone:
            raise _not_frames(path)
        raise InputError(
            f"{path} is no PLY; name the folder, whose PLYs are taken: dfcgs encode "
            f"{shlex.quote(str(path.parent))} out.dgs"
        )
    return False


def _refuse_folders(folders: list[Path], files: list[Path]) -> InputError:
    if files:
        return InputError(
            f"{folders[0]} is a folder and {files[0]} a file; name one folder, whose PLYs are taken, or PLY "
            "files alone"
        )
    parents = {str(path.parent) for path in folders}
    parent = parents.pop() if len(parents) == 1 else "PARENT"
    return InputError(
        f"{len(folders)} folders ({folders[0]}, {folders[1]}...); for one frame in each of them name the "
        f"folder that holds them: dfcgs encode {shlex.quote(parent)} out.dgs"
    )


def typed_frames(arguments: Sequence[str | Path]) -> Path | list[Path]:
    """The folder that is meant, or the files.

    `arguments`: a folder, PLY files, globs of them, or an .npz. InputError for anything else, with
    what to type instead.
    """
    paths: list[Path] = []
    for argument in map(str, arguments):
        if not argument:
            raise InputError("the name of the frames' folder is empty; is a variable of the shell not set?")
        if argument == "-":
            raise InputError("-: frames cannot be read from a pipe; name a folder of PLY files")
        paths += _expanded(argument)
    folders = [path for path in paths if _check_one(path, alone=len(paths) == 1)]
    if len(paths) == 1 and folders:
        return folders[0]
    if folders:
        raise _refuse_folders(folders, [path for path in paths if path not in folders])
    return paths
