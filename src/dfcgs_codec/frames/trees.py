"""Frames in trees of folders, as trainers leave them: found, reduced to the latest iteration, and told."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.listing import check_is_file, entries
from dfcgs_codec.frames.names import ITERATION, Name, groups, parse
from dfcgs_codec.frames.refusals import counted, glob_for, some

#: the folder of Gaussians that 3DGStream and 4DGC add to one frame
_ADDED = "added"
#: point clouds that training starts from, which trainers leave beside their results
_POINT_CLOUDS = ("input.ply", "points3d.ply", "sparse_pc.ply")
#: as deep as scene/frame000001/point_cloud/iteration_150/point_cloud.ply, and one more
_MAX_DEPTH = 6
_MAX_FOLDERS = 50_000


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


@dataclass
class Tree:
    """PLYs below a folder: relative paths, sorted; `unread`: folders that could not be read.

    `is_whole`: there were not too many folders to look into all.
    """

    names: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    folders: int = 0
    is_whole: bool = True


@dataclass(frozen=True)
class Chosen:
    """Frames in no order, as relative paths, and what is to be said of the choice."""

    names: list[str]
    notes: list[str]


def is_point_cloud(name: str) -> bool:
    """Whether a PLY is called like one that training starts from."""
    return name.rpartition("/")[2].lower() in _POINT_CLOUDS


def walk(folder: Path, *, most: int = _MAX_FOLDERS) -> Tree:
    """All PLYs in the subfolders of `folder`, but hidden ones; not in more than `most` folders."""
    tree = Tree()
    seen: set[tuple[int, int]] = set()
    waiting = [(folder, "", 0)]
    while waiting and tree.is_whole:
        below, relative, depth = waiting.pop()
        try:
            status = below.stat()
            # links may lead back
            if (status.st_dev, status.st_ino) in seen:
                continue
            inner = entries(below)
        except (OSError, InputError):
            tree.unread.append(relative)
            continue
        seen.add((status.st_dev, status.st_ino))
        tree.folders += 1
        tree.is_whole = tree.folders < most
        for entry in reversed(inner):
            if entry.name.startswith("."):
                continue
            if entry.name.lower().endswith(".ply"):
                tree.names += [relative + entry.name] * (depth > 0)
            elif depth < _MAX_DEPTH and entry.is_dir():
                waiting.append((below / entry.name, f"{relative}{entry.name}/", depth + 1))
    tree.names.sort()
    return tree


def _split(name: str) -> tuple[str, int | None]:
    """The name with the number of its innermost iteration folder left out, and that number."""
    parts = name.split("/")
    for position in range(len(parts) - 2, -1, -1):
        match = ITERATION.fullmatch(parts[position])
        if match:
            parts[position] = match["kind"]
            return "/".join(parts), int(match["number"])
    return name, None


def latest(names: list[str]) -> Chosen:
    """Of files that differ in the number of their iteration folder alone, the one of the latest."""
    best: dict[str, tuple[int, str]] = {}
    earlier: list[str] = []
    for name in names:
        key, iteration = _split(name)
        found = (-1 if iteration is None else iteration, name)
        if key in best:
            earlier.append(min(best[key], found)[1])
            found = max(best[key], found)
        best[key] = found
    notes = _said(best, sorted(earlier))
    return Chosen([name for _, name in best.values()], notes)


def _said(best: dict[str, tuple[int, str]], earlier: list[str]) -> list[str]:
    notes = []
    counts = Counter(iteration for iteration, _ in best.values() if iteration >= 0)
    if earlier:
        which = f"{max(counts)}" if len(counts) == 1 else f"{min(counts)} to {max(counts)}"
        notes.append(
            f"the latest iteration of each frame is taken ({which}); {len(earlier)} files of earlier "
            f"ones are left out ({some(earlier)})"
        )
    if len(counts) > 1:
        usual = counts.most_common(1)[0][0]
        other = next(found for found in best.values() if found[0] not in (usual, -1))
        notes.append(
            f"frames are of different iterations: {counts[usual]} of {usual}, {other[1]} of {other[0]}"
        )
    return notes


def _missing(folder: Path, names: list[str]) -> list[str]:
    """Folders that are called like those of frames, beside them, but hold none."""
    missing: list[str] = []
    for depth in range(max(name.count("/") for name in names)):
        used = {tuple(name.split("/")[: depth + 1]) for name in names if name.count("/") > depth}
        numbered = [parse(path[-1]) for path in used if not ITERATION.fullmatch(path[-1])]
        shapes = {name.shape(decimals=True) for name in numbered if name.tokens}
        for parent in sorted({path[:-1] for path in used}):
            missing += [
                "/".join((*parent, entry.name))
                for entry in entries(folder.joinpath(*parent))
                if (*parent, entry.name) not in used
                and parse(entry.name).shape(decimals=True) in shapes
                and not check_is_file(folder.joinpath(*parent, entry.name), or_folder=True)
            ]
    return missing


def find(folder: Path) -> Chosen | None:
    """Frames in the subfolders of `folder`, or None; the notes say which and how to choose others.

    InputError where several kinds of PLYs are found, for any of them may be meant.
    """
    tree = walk(folder)
    point_clouds = [name for name in tree.names if is_point_cloud(name)]
    names = [name for name in tree.names if not is_point_cloud(name)]
    if not names:
        return None
    if not tree.is_whole:
        raise InputError(
            f"{folder}: no PLY in the folder itself, and more than {_MAX_FOLDERS} folders below it; choose "
            f"the frames with --pattern, such as {names[0]}"
        )
    names, parts = without_parts(names)
    names, copies = without_copies(names)
    found = latest(names)
    kinds = groups([parse(name) for name in found.names])
    if len(kinds) > 1:
        raise _refuse_kinds(folder, kinds)
    pattern = glob_for(kinds[0]) or found.names[0]
    taken = counted(found.names)
    notes = [f"no PLY in {folder} itself; taken: {taken} of its subfolders, as with --pattern {pattern}"]
    notes += found.notes
    notes += of_parts(parts, found.names) + of_copies(copies)
    if point_clouds:
        notes.append(f"left out, as training starts from it: {some(point_clouds)}")
    missing = _missing(folder, found.names)
    if missing:
        notes.append(f"left out, as there is no PLY in it: {some(missing)}")
    for name in found.names:
        check_is_file(folder / name)
    if tree.unread:
        notes.append(f"folders that cannot be read: {some(tree.unread)}")
    return Chosen(found.names, notes)


def _refuse_kinds(folder: Path, kinds: list[list[Name]]) -> InputError:
    everything = {name.text for kind in kinds for name in kind}
    choices = []
    for kind in kinds[:3]:
        pattern = glob_for(kind, everything - {name.text for name in kind})
        files = counted(kind)
        choices.append(f"--pattern {pattern} ({files})" if pattern else f"{kind[0].text} ({files})")
    return InputError(
        f"{folder}: no PLY in the folder itself, and {len(kinds)} kinds in its subfolders; choose one: "
        + ", ".join(choices)
    )
