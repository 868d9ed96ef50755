"""Files that hold Gaussians, but are no PLYs: what they are and how they become PLYs."""

from __future__ import annotations

from collections.abc import Iterable

_CONVERT = "'splat-transform {name} {stem}.ply' (npm package @playcanvas/splat-transform) makes a PLY of each"
_EXPORT = "let the trainer that wrote it save its Gaussians as PLY"
_UNPACK = "unpack it and name the folder of its PLYs"

#: ending -> what it is, what to do
_KINDS = {
    ".splat": ("splats of antimatter15's viewer", _CONVERT),
    ".ksplat": ("splats of mkkellogg's viewer", _CONVERT),
    ".spz": ("Niantic's compressed splats", _CONVERT),
    ".sog": ("PlayCanvas' compressed splats", _CONVERT),
    ".npz": ("numpy arrays", _EXPORT),
    ".npy": ("a numpy array", _EXPORT),
    ".pth": ("a training checkpoint", _EXPORT),
    ".pt": ("a training checkpoint", _EXPORT),
    ".ckpt": ("a training checkpoint", _EXPORT),
    ".zip": ("an archive", _UNPACK),
    ".tar": ("an archive", _UNPACK),
    ".tgz": ("an archive", _UNPACK),
    ".gz": ("compressed", _UNPACK),
    ".xz": ("compressed", _UNPACK),
    ".zst": ("compressed", _UNPACK),
    ".7z": ("an archive", _UNPACK),
    ".rar": ("an archive", _UNPACK),
}
#: what may be a frame beside PLYs
_SPLATS = (".splat", ".ksplat", ".spz", ".sog")
_MADE_OF_PLY = (".gz", ".xz", ".zst", ".part", ".partial", ".tmp", ".bak", ".download", ".crdownload", "~")


def _ending(name: str) -> str:
    return "." + name.lower().rpartition(".")[2]


def describe(name: str) -> str | None:
    """What a file of this name is and which command makes a PLY of it; None if its ending says nothing."""
    kind = _KINDS.get(_ending(name))
    if kind is None:
        return None
    return f"{kind[0]}; {kind[1].format(name=name, stem=name.rpartition('.')[0])}"


def like_frames(names: Iterable[str]) -> list[str]:
    """Those that may be frames, too: splats, and PLYs that are packed or unfinished."""
    found = []
    for name in names:
        lower = name.lower()
        unfinished = any(lower.endswith(f".ply{end}") for end in _MADE_OF_PLY)
        if not name.startswith(".") and (lower.endswith(_SPLATS) or unfinished):
            found.append(name)
    return found


def first_described(names: Iterable[str]) -> str | None:
    """The first of the files that is known, with how many there are of its kind and what to do."""
    shown = [name for name in names if not name.startswith(".")]
    for name in shown:
        what = describe(name)
        if what is not None:
            count = sum(_ending(other) == _ending(name) for other in shown)
            more = f" (and {count - 1} more like it)" if count > 1 else ""
            return f"{name}{more} is {what}"
    return None
