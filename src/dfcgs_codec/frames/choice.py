"""The frames of a folder, and the frames among named files."""

from __future__ import annotations

import os
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.frames.foreign import first_described, like_frames, readable
from dfcgs_codec.frames.listing import Listing, entries, matches
from dfcgs_codec.frames.refusals import counted, some
from dfcgs_codec.frames.trees import Chosen, find, is_point_cloud, latest, walk

DEFAULT_PATTERN = "*.ply"
#: folders that are looked into for PLYs that are left out
_LOOKED_INTO = 2000


def _left_out(names: list[str], what: str, why: str) -> list[str]:
    return [f"{counted(names, what)} left out, {why}: {some(names)}"] if names else []


def _nothing(folder: Path, pattern: str, listing: Listing, names: list[str]) -> InputError:
    known = first_described(names) if pattern == DEFAULT_PATTERN else None
    below = [] if pattern == DEFAULT_PATTERN else walk(folder, most=_LOOKED_INTO).names
    if known:
        reason = known
    elif listing.hidden:
        reason = f"{counted(listing.hidden, 'hidden file')} ({some(listing.hidden)}) left out"
    elif not names:
        reason = "the folder is empty"
    elif below:
        reason = f"PLYs in its subfolders are {some(below)}; --pattern chooses other names"
    else:
        reason = "--pattern chooses other names"
    return InputError(f"{folder}: no file matches '{pattern}'; {reason}")


def _without_point_clouds(names: list[str]) -> Chosen:
    """Without 'input.ply', where there are other frames."""
    others = [name for name in names if not is_point_cloud(name)]
    if others and len(others) < len(names):
        clouds = [name for name in names if is_point_cloud(name)]
        return Chosen(others, _left_out(clouds, "file", "as training starts from it"))
    return Chosen(names, [])


def _by_default(folder: Path, listing: Listing) -> Chosen | None:
    """PLYs in the folder itself or, where there is none, in its subfolders."""
    if all(is_point_cloud(name) for name in listing.names):
        tree = find(folder)
        if tree is not None:
            clouds = _left_out(listing.names, "file", "as training starts from it")
            return Chosen(tree.names, [*tree.notes, *clouds])
    if not listing.names:
        return None
    found = _without_point_clouds(listing.names)
    tree_below = walk(folder, most=_LOOKED_INTO)
    notes = _left_out(tree_below.names, "PLY file", "in subfolders (--pattern takes them)")
    return Chosen(found.names, [*found.notes, *notes])


def _foreign(beside: list[str]) -> Chosen | None:
    """Files in another format that can be read, where there is no PLY; of several formats the commoner."""
    names = sorted(readable(beside))
    if not names:
        return None
    endings = [Path(name).suffix.lower() for name in names]
    ending = max(sorted(set(endings)), key=endings.count)
    taken = [name for name, its in zip(names, endings, strict=True) if its == ending]
    return Chosen(taken, [f"no PLY in the folder: {counted(taken, f'{ending} file')} taken as frames"])


def frames_in(folder: Path, pattern: str) -> Chosen:
    """The frames of `folder`: files that match the glob `pattern`, or by default those that trainers leave.

    InputError where there are none, and see `listing.matches` and `trees.find`.
    """
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise InputError(f"{folder} {what}; expected a folder with one PLY file per frame")
    listing = matches(folder, pattern)
    beside = [entry.name for entry in entries(folder)]
    found: Chosen | None
    if pattern == DEFAULT_PATTERN:
        found = _by_default(folder, listing) or _foreign(beside)
    else:
        found = latest(listing.names)
        if len(found.names) < 2:
            # nothing but the iteration varies: these are the frames that were asked for
            found = Chosen(listing.names, []) if listing.names else None
    if found is None:
        raise _nothing(folder, pattern, listing, beside)
    notes = _left_out(listing.hidden, "hidden file", "as their names begin with '.'")
    if pattern == DEFAULT_PATTERN:
        others = [name for name in like_frames(beside) if name not in found.names]
        notes += _left_out(others, "file", "as it is no PLY")
    return Chosen(found.names, [*found.notes, *notes])


def frames_named(paths: list[Path]) -> tuple[Path, Chosen]:
    """The folder that holds all the files, and these relative to it."""
    places = [Path(os.path.abspath(path)) for path in paths]
    folder = Path(os.path.commonpath([place.parent for place in places]))
    names = [place.relative_to(folder).as_posix() for place in places]
    twice = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    if twice:
        raise InputError(f"{folder}: {some(sorted(twice))} named twice; name each frame once")
    hidden = [name for name in names if name.rpartition("/")[2].startswith(".")]
    found = latest(sorted(set(names) - set(hidden)) or sorted(names))
    others = sorted(
        entry.name
        for entry in entries(folder)
        if entry.name.lower().endswith(".ply") and entry.name not in names and not entry.name.startswith(".")
    )
    notes = [f"{counted(found.names, 'file')} named as frames: ordered as those of a folder"]
    if len(found.names) == 1:
        notes = [f"{found.names[0]} is the only frame"]
    notes += _left_out(sorted(set(hidden) - set(found.names)), "hidden file", "as their names begin with '.'")
    notes += _left_out(others, "other PLY file", f"in {folder}")
    return folder, Chosen(found.names, [*notes, *found.notes])
