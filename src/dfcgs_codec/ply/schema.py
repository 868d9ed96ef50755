"""Which properties of a PLY are a 3DGS frame, decided by its header alone."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from dfcgs_codec.ply.header import Element, Header
from dfcgs_codec.ply.policy import InputPolicy, shortened

POSITIONS = ("x", "y", "z")
NORMALS = ("nx", "ny", "nz")
SH_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES = ("scale_0", "scale_1", "scale_2")
ROTATIONS = ("rot_0", "rot_1", "rot_2", "rot_3")
REQUIRED = (*POSITIONS, *SH_DC, "opacity", *SCALES, *ROTATIONS)
FILTER = "filter_3D"
RGB = ("red", "green", "blue")
#: CloudCompare puts this before the names of all properties that it does not know
_PREFIX = "scalar_"
_REST = re.compile(r"f_rest_\d+")
_DEGREE_4 = 24

#: log-scale of an axis without extent: 2e-9 scene units, far below a pixel, its square a normal float32
FLAT_LOG_SCALE = -20.0


@dataclass(frozen=True)
class Layout:
    """Where a frame's arrays are in element vertex: for each attribute the names as in the file.

    Attributes are those of GaussianCloud, 'normals' where the file has them and 'filter' where it is wanted.
    """

    columns: dict[str, tuple[str, ...]]
    sh_degree: int
    dropped: tuple[str, ...] = ()
    flat: bool = False
    rgb: bool = False
    remarks: tuple[str, ...] = ()


def rest_names(sh_degree: int) -> tuple[str, ...]:
    """Properties of the higher SH coefficients, channel first."""
    return tuple(f"f_rest_{i}" for i in range(3 * SH_REST_COEFFICIENTS[sh_degree]))


def property_names(sh_degree: int) -> tuple[str, ...]:
    """Properties of an output PLY, in the INRIA order."""
    return (*POSITIONS, *NORMALS, *SH_DC, *rest_names(sh_degree), "opacity", *SCALES, *ROTATIONS)


def standard_columns(sh_degree: int) -> dict[str, tuple[str, ...]]:
    """For each attribute of GaussianCloud the names of its properties."""
    return {
        "positions": POSITIONS,
        "rotations": ROTATIONS,
        "scales": SCALES,
        "opacities": ("opacity",),
        "sh_dc": SH_DC,
        "sh_rest": rest_names(sh_degree),
    }


def frame_layout(header: Header, policy: InputPolicy, path: Path) -> Layout:
    """The frame that element vertex holds; InputError for what `policy` does not allow, by name."""
    vertex = header.vertex
    names = _names(vertex, path)
    degree, rest, dropped = _sh_rest(names, policy, path)
    flat = "scale_2" not in names and {"scale_0", "scale_1"} <= names.keys()
    rgb = "f_dc_0" not in names and names.keys() >= {"opacity", *RGB}
    columns = standard_columns(degree) | {"sh_rest": rest}
    if flat:
        columns["scales"] = SCALES[:2]
    if rgb:
        columns["sh_dc"] = RGB
        _check_rgb(vertex, policy, path)
    _check_present(names, columns, header, path)
    if FILTER in names:
        _check_filter(policy, path)
        columns["filter"] = (FILTER,)
    columns |= {"normals": NORMALS} if names.keys() >= set(NORMALS) else {}
    dropped += _extra(header, names, columns, policy, path)
    in_file = {key: tuple(names[n] for n in wanted) for key, wanted in columns.items()}
    _check_numbers(vertex, in_file, path)
    layout = Layout(in_file, degree, dropped, flat, rgb)
    return replace(layout, remarks=_remarks(layout, prefixed=names["opacity"] != "opacity"))


def _names(vertex: Element, path: Path) -> dict[str, str]:
    """Name as in 3DGS PLYs -> name in the file, where CloudCompare may have put its prefix before it."""
    counts = Counter(p.name for p in vertex.properties)
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        raise InputError(
            f"{path}: property '{twice[0]}' is there {counts[twice[0]]} times; export the frame again"
        )
    names = {}
    for name in counts:
        bare = name.removeprefix(_PREFIX)
        known = bare in (*REQUIRED, FILTER, *NORMALS) or _REST.fullmatch(bare)
        names[bare if known and bare not in counts else name] = name
    return names


def _sh_rest(
    names: dict[str, str], policy: InputPolicy, path: Path
) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """SH degree, names of the higher coefficients, and what is left out of them."""
    found = [name for name in names if _REST.fullmatch(name)]
    if len(found) == 3 * _DEGREE_4:
        if not policy.drop_extra:
            raise InputError(
                f"{path}: SH degree 4 (72 f_rest_* properties), and degrees 0 to 3 are coded; "
                "--drop-extra leaves the coefficients of degree 4 out"
            )
        kept = SH_REST_COEFFICIENTS[3]
        rest = tuple(f"f_rest_{c * _DEGREE_4 + i}" for c in range(3) for i in range(kept))
        return 3, rest, ("the f_rest_* of SH degree 4",)
    for degree, coefficients in enumerate(SH_REST_COEFFICIENTS):
        if len(found) == 3 * coefficients:
            return degree, rest_names(degree), ()
    raise InputError(
        f"{path}: {len(found)} f_rest_* properties; 0, 9, 24 or 45 (SH degree 0 to 3) were expected"
    )


def _check_rgb(vertex: Element, policy: InputPolicy, path: Path) -> None:
    what = f"{path}: colours are red, green, blue in place of f_dc_0, f_dc_1, f_dc_2 (SH coefficients)"
    if any(p.kind != "u1" or p.length_kind for p in vertex.properties if p.name in RGB):
        raise InputError(f"{what}, and not of type uchar; export the frame with f_dc_0..2")
    if not policy.drop_extra:
        raise InputError(f"{what}; --drop-extra takes them as SH degree 0")


def _check_present(
    names: dict[str, str], columns: dict[str, tuple[str, ...]], header: Header, path: Path
) -> None:
    missing = [name for wanted in columns.values() for name in wanted if name not in names]
    if not missing:
        return
    first = next((name for name in REQUIRED if name in missing), missing[0])
    what = f"{path}: property '{first}' is missing"
    if {"opacity", "scale_0", "rot_0"}.isdisjoint(names):
        shape = "a mesh" if any(e.count and e.name == "face" for e in header.elements) else "a point cloud"
        raise InputError(
            f"{what}: {shape} ({shortened(list(names))}), no 3D Gaussians; give the PLYs that training 3DGS "
            "writes, such as point_cloud/iteration_30000/point_cloud.ply"
        )
    raise InputError(f"{what} (a 3DGS PLY has {', '.join(REQUIRED)}); export the frame again")


def _check_filter(policy: InputPolicy, path: Path) -> None:
    if not policy.bake_filter:
        raise InputError(
            f"{path}: property 'filter_3D' (mip-splatting) is part of each Gaussian's size and opacity; "
            "export the frame fused (create_fused_ply.py), or: --bake-filter puts it into scale and opacity"
        )


def _extra(
    header: Header,
    names: dict[str, str],
    columns: dict[str, tuple[str, ...]],
    policy: InputPolicy,
    path: Path,
) -> tuple[str, ...]:
    """Properties and elements that are left out, after a refusal if that is not allowed."""
    known = {*NORMALS, *(name for wanted in columns.values() for name in wanted)}
    extra = [name for name in names if name not in known]
    if policy.drop_extra:
        extra = [name for name in extra if not _REST.fullmatch(name)]
    elements = [e.name for e in header.elements if e.name != "vertex" and e.count]
    if not policy.drop_extra and (extra or elements):
        what = [f"properties that the codec does not keep: {shortened(extra)}"] * bool(extra)
        what += [f"elements that the codec does not keep: {shortened(elements)}"] * bool(elements)
        raise InputError(f"{path}: {', and '.join(what)}; --drop-extra encodes without them")
    return (*extra, *(f"element {name}" for name in elements))


def _check_numbers(vertex: Element, columns: dict[str, tuple[str, ...]], path: Path) -> None:
    lists = {p.name for p in vertex.properties if p.length_kind}
    for name in (name for wanted in columns.values() for name in wanted):
        if name in lists:
            raise InputError(f"{path}: property '{name}' is a list; 3DGS properties are numbers")


def _remarks(layout: Layout, *, prefixed: bool) -> tuple[str, ...]:
    found = []
    if layout.dropped:
        found.append(f"left out: {shortened(layout.dropped)}")
    if layout.flat:
        found.append(f"two scales (2D Gaussians); the third is set to {FLAT_LOG_SCALE:g}, which is flat")
    if layout.rgb:
        found.append("red, green, blue are taken as SH degree 0")
    if "filter" in layout.columns:
        found.append("filter_3D is put into scale and opacity")
    if prefixed:
        found.append(f"names of properties begin with {_PREFIX} (CloudCompare); read without it")
    return tuple(found)
