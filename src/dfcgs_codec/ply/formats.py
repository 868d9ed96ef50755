"""Files that are not plain 3DGS PLYs: what they are, and what makes PLYs of them."""

from __future__ import annotations

import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

#: the reader of other formats that the extra `formats` installs
READER = "gaussforge"
#: formats that are read where `READER` is installed, by the end of the file's name, lower case
FOREIGN_SUFFIXES = (".splat", ".spz")
#: names of files that can be frames, lower case
FRAME_SUFFIXES = (".ply", *FOREIGN_SUFFIXES)

_SNIFFED = 512
_TRAINER = "export it as PLY with the program that wrote it, such as 'ns-export gaussian-splat' of nerfstudio"
_COMPRESSED = ".compressed.ply"
_BY_SUFFIX = {
    _COMPRESSED: "a compressed PLY (chunks and packed_position)",
    ".splat": "a .splat file (32 bytes to a Gaussian)",
    ".spz": "an SPZ file of Niantic",
    ".ksplat": "a .ksplat file",
    ".sog": "an SOG file of PlayCanvas (images in a zip)",
    ".lcc": "an LCC file",
}
_WITHOUT_CONVERTER = {
    ".npz": (
        "numpy arrays, no PLY; name the file itself if it is the params.npz of Dynamic 3D Gaussians, or "
        f"{_TRAINER}"
    ),
    ".npy": f"a numpy array, no PLY; {_TRAINER}",
    ".pth": f"a PyTorch checkpoint, no PLY; {_TRAINER}",
    ".pt": f"a PyTorch checkpoint, no PLY; {_TRAINER}",
    ".ckpt": f"a PyTorch checkpoint, no PLY; {_TRAINER}",
    ".dgs": "a file of this codec, encoded already; 'dfcgs decode' makes PLYs of it",
}


class _Magic(NamedTuple):
    start: bytes
    what: str


_MAGICS = (
    _Magic(b"version https://git-lfs", "a git-lfs pointer, not the file itself; 'git lfs pull' fetches it"),
    _Magic(b"NGSP", "an SPZ file"),
    _Magic(b"\x1f\x8b", "gzip-compressed data; unpack it, or call it .spz if it is one"),
    _Magic(b"\xff\xfe", "text in UTF-16; save it as plain ASCII or UTF-8"),
    _Magic(b"\xfe\xff", "text in UTF-16; save it as plain ASCII or UTF-8"),
    _Magic(b"PK\x03\x04", "a zip archive (or .sog, .npz, .pth); unpack it, or export it as PLY"),
    _Magic(b"\x28\xb5\x2f\xfd", "zstandard-compressed data; unpack it"),
    _Magic(b"glTF", "a binary glTF file; export it as PLY"),
    _Magic(b"\x89PNG", "a PNG image"),
    _Magic(b"\xff\xd8\xff", "a JPEG image"),
    _Magic(b"\x93NUMPY", "a numpy array"),
    _Magic(b"\x80", "a Python pickle, perhaps a PyTorch checkpoint; export it as PLY"),
    _Magic(b"PLY", "'PLY' in capital letters; the first line of a PLY is 'ply'"),
)


def converter(path: Path, suffix: str) -> str:
    """The command that makes a PLY of the file; `suffix` is the end of its name."""
    source = str(path)
    stem = source[: -len(suffix)] if source.lower().endswith(suffix) else str(path.with_suffix(""))
    target = f"{stem}.ply"
    made = ""
    if suffix == _COMPRESSED:
        # a folder of its own: among the frames it would be one frame more
        made, target = "mkdir -p plain && ", f"plain/{Path(target).name}"
    return f"{made}npx @playcanvas/splat-transform {shlex.quote(source)} {shlex.quote(target)}"


def reader_installed() -> bool:
    """Whether `.splat`, `.spz` and compressed PLYs can be read."""
    return find_spec(READER) is not None


def advice(path: Path, suffix: str) -> str:
    """What to do with a file of a known other format."""
    command = f"'{converter(path, suffix)}' makes a plain PLY of it"
    if suffix in (*FOREIGN_SUFFIXES, _COMPRESSED) and not reader_installed():
        return f"pip install 'dfcgs-codec[formats]' lets it be read, or {command}"
    return command


def describe_foreign(path: Path) -> str | None:
    """What a file is that is no plain PLY, by its name, and what makes PLYs of it; None if nothing is known.

    One line without the file's name, such as "a .ksplat file; 'npx ...' makes a PLY of it". Files that may be
    read all the same (see FRAME_SUFFIXES) are described too.
    """
    name = path.name.lower()
    for suffix, what in _BY_SUFFIX.items():
        if name.endswith(suffix):
            return f"{what}; {advice(path, suffix)}"
    for suffix, what in _WITHOUT_CONVERTER.items():
        if name.endswith(suffix):
            return what
    return None


def describe_content(data: bytes) -> str:
    """What the first bytes of a file are that does not start as a PLY does."""
    if not data:
        return "it is empty; copy or export the frame again"
    for magic in _MAGICS:
        if data.startswith(magic.start):
            return f"it is {magic.what}"
    if data[:_SNIFFED].lstrip()[:1] == b"<":
        return "it is a web page or XML; download the file itself"
    if not any(data[:_SNIFFED]):
        return "it begins with zeros: a copy that was not finished; copy it again"
    return "it does not start with 'ply'"
