"""`--views`: the cameras that are named, or those beside the frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.views.camera import Views
from dfcgs_codec.views.read import find_views, read_views

_NONE = "none"


def _called(path: Path) -> str:
    """The file's name; of a folder, which COLMAP calls '0', that of the one around it, too."""
    return "/".join(path.parts[-2:]) if path.is_dir() else path.name


def views_named(text: str | None) -> Views | None:
    """The cameras of the file or folder that the user names; None for 'none' and where nothing is said."""
    return None if text is None or text == _NONE else read_views(text)


def views_beside(frame_paths: Sequence[Path]) -> tuple[Views | None, list[str]]:
    """The cameras that lie beside the frames, and a note where some do that cannot be read."""
    path = find_views(frame_paths)
    if path is None:
        return None, []
    try:
        return read_views(path), []
    except InputError as error:
        reason = str(error).removeprefix(f"{path}: ")
        return None, [f"{_called(path)} was found beside the frames and is not used: {reason}"]


def views_note(views: Views | None) -> list[str]:
    """How many cameras there are, and in which file."""
    if views is None or views.path is None:
        return []
    count = len(views.cameras)
    return [f"views: {count} camera{'' if count == 1 else 's'} of {_called(views.path)}"]
