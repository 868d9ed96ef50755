"""What a caller allows, and what a frame's header says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class InputPolicy:
    """What to do with input that is not quite a 3DGS PLY; by default it is refused.

    drop_extra   leave out what the codec does not keep: properties, elements, trailing bytes, SH degree 4
    repair       put what viewers show in place of values that are not finite and of empty rows
    bake_filter  fold the property filter_3D of mip-splatting into scale and opacity
    keep_bits    no check of values at all: for coding that keeps every bit pattern
    """

    drop_extra: bool = False
    repair: bool = False
    bake_filter: bool = False
    keep_bits: bool = False


@dataclass(frozen=True)
class PlyHeader:
    """What a frame's header says about its Gaussians.

    comments  all comment lines, without the word 'comment' and its space, in whatever encoding they are
    dropped   properties and elements that are left out, as the policy allows
    flat      there are two scales (2D Gaussians); the third axis is made flat
    remarks   what the user should hear about this frame, one sentence each, without the file's name
    """

    num_gaussians: int
    sh_degree: int
    comments: tuple[bytes, ...] = ()
    dropped: tuple[str, ...] = ()
    flat: bool = False
    remarks: tuple[str, ...] = ()


def shortened(names: Sequence[str]) -> str:
    """Names in a row, the middle left out where there are many."""
    if len(names) <= 8:
        return ", ".join(names)
    return f"{', '.join(names[:3])}, ..., {names[-1]} ({len(names)} in all)"


def said_once(names: Iterable[str], headers: Iterable[PlyHeader]) -> list[str]:
    """The remarks of all frames, each with the first file that it is about and the number of others."""
    pairs = zip(names, headers, strict=True)
    return gathered(f"{name}: {remark}" for name, header in pairs for remark in header.remarks)


def gathered(notes: Iterable[str]) -> list[str]:
    """Notes that begin with a file's name and ': ', those that say the same of several files as one."""
    files: dict[str, list[str]] = {}
    for note in notes:
        name, colon, text = note.partition(": ")
        files.setdefault(text if colon else note, []).append(name if colon else "")
    return [
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {text}" if names[0] else text
        for text, names in files.items()
    ]
