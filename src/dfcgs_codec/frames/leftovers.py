"""What trainers leave beside the frames of a tree that is no frame itself: parts of frames, and copies."""

from __future__ import annotations

from dfcgs_codec.frames.names import ITERATION
from dfcgs_codec.frames.refusals import some

#: the folder of Gaussians that 3DGStream and 4DGC add to one frame
_ADDED = "added"


def _is_part(name: str) -> bool:
    return _ADDED in name.split("/")[:-1]


def without_parts(names: list[str]) -> tuple[list[str], list[str]]:
    """Frames, and what is added to one of them; all are frames where nothing else is there."""
    frames = [name for name in names if not _is_part(name)]
    return (frames, [name for name in names if _is_part(name)]) if frames else (names, [])


def without_copies(names: list[str]) -> tuple[list[str], list[str]]:
    """Frames, and what lies below a folder called like a frame beside it.

    QUEEN leaves "0001/point_cloud.ply" and the same in "0001/point_cloud/iteration_8000/point_cloud.ply".
    """
    stems = {name.rpartition(".")[0] for name in names}

    def is_copy(name: str) -> bool:
        folders = name.split("/")[:-1]
        return any(
            ITERATION.fullmatch(folder) and "/".join(folders[:depth]) in stems
            for depth, folder in enumerate(folders)
        )

    return [name for name in names if not is_copy(name)], [name for name in names if is_copy(name)]


def _place(name: str) -> tuple[str, int]:
    """The folder of a frame's iterations and the number of this one, or the file's own folder and -1."""
    folders = name.split("/")[:-1]
    for depth, folder in enumerate(folders):
        if match := ITERATION.fullmatch(folder):
            return "/".join(folders[:depth]), int(match["number"])
    return "/".join(folders), -1


def of_parts(parts: list[str], frames: list[str]) -> list[str]:
    """What is to be said of the parts that are left out beside `frames`."""
    if not parts:
        return []
    taken = dict(map(_place, frames))
    is_later = any(iteration > taken.get(folder, -1) for folder, iteration in map(_place, parts))
    where = "the frames as taken lack; docs/inputs.md joins them" if is_later else "it already holds"
    return [
        f"left out: {len(parts)} PLYs in folders called '{_ADDED}' ({some(parts)}): what is added to one "
        f"frame, which {where}"
    ]


def of_copies(copies: list[str]) -> list[str]:
    """What is to be said of the copies that are left out."""
    if not copies:
        return []
    return [f"left out, as the frame itself lies beside their folder: {some(copies)}"]
