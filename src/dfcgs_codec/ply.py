"""Standard 3DGS PLY files <-> GaussianCloud; parsing itself is plyfile's."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from plyfile import PlyData, PlyElement, PlyParseError

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud

_POSITIONS = ("x", "y", "z")
_NORMALS = ("nx", "ny", "nz")
_SH_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALES = ("scale_0", "scale_1", "scale_2")
_ROTATIONS = ("rot_0", "rot_1", "rot_2", "rot_3")
_REQUIRED = (*_POSITIONS, *_SH_DC, "opacity", *_SCALES, *_ROTATIONS)
_MAX_HEADER_LINES = 512

#: what --repair puts in place of a value that is not finite, and of a zero quaternion
REPAIRED_VALUE = 0.0
REPAIRED_QUATERNION = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class InputPolicy:
    """What to do with input that is not quite a 3DGS PLY."""

    drop_extra: bool = False
    repair: bool = False


@dataclass(frozen=True)
class PlyHeader:
    """What a PLY header says about its Gaussians."""

    num_gaussians: int
    sh_degree: int


def _rest_names(sh_degree: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{i}" for i in range(3 * SH_REST_COEFFICIENTS[sh_degree]))


def property_names(sh_degree: int) -> tuple[str, ...]:
    """Properties of an output PLY, in the INRIA order."""
    rest = _rest_names(sh_degree)
    return (*_POSITIONS, *_NORMALS, *_SH_DC, *rest, "opacity", *_SCALES, *_ROTATIONS)


def _sh_degree(names: Iterable[str], path: Path) -> int:
    count = sum(1 for name in names if re.fullmatch(r"f_rest_\d+", name))
    for degree, coefficients in enumerate(SH_REST_COEFFICIENTS):
        if count == 3 * coefficients:
            return degree
    raise InputError(f"{path}: {count} f_rest_* properties; 0, 9, 24 or 45 (SH degree 0 to 3) were expected")


def peek_header(path: Path) -> PlyHeader:
    """Number of Gaussians and SH degree, from the header alone; InputError if it is not a 3DGS PLY."""
    names: list[str] = []
    count = None
    element: list[str] = []
    with path.open("rb") as file:
        if file.readline(16).strip() != b"ply":
            raise InputError(f"{path}: not a PLY file (it does not start with 'ply')")
        for _ in range(_MAX_HEADER_LINES):
            words = file.readline(4096).decode("ascii", "replace").split()
            if words[:1] == ["end_header"]:
                break
            if words[:1] == ["element"]:
                element = words[1:2]
                if element == ["vertex"] and len(words) == 3 and words[2].isdigit():
                    count = int(words[2])
            elif words[:1] == ["property"] and element == ["vertex"]:
                names.append(words[-1])
        else:
            raise InputError(f"{path}: the PLY header has no end_header line: truncated or not a PLY")
    if count is None:
        raise InputError(f"{path}: no 'element vertex': the file holds no Gaussians")
    return PlyHeader(count, _sh_degree(names, path))


def _vertex_data(path: Path) -> npt.NDArray[Any]:
    try:
        data = PlyData.read(str(path))
        return np.asarray(data["vertex"].data)
    except (PlyParseError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: damaged or truncated PLY ({error}); export the frame again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _check_properties(
    data: npt.NDArray[Any], expected: tuple[str, ...], policy: InputPolicy, path: Path
) -> None:
    names = data.dtype.names or ()
    missing = [name for name in expected if name not in names]
    if missing:
        raise InputError(
            f"{path}: property '{missing[0]}' is missing (a 3DGS PLY has {', '.join(_REQUIRED)})"
        )
    for name in names:
        if data.dtype[name].kind not in "fiu":
            raise InputError(f"{path}: property '{name}' is a list; 3DGS properties are numbers")
    if policy.drop_extra:
        return
    extra = [name for name in names if name not in (*expected, *_NORMALS)]
    extra += [name for name in _NORMALS if name in names and data[name].any()]
    if extra:
        raise InputError(
            f"{path}: properties that the codec does not keep: {', '.join(extra)}; "
            "--drop-extra encodes without them"
        )


def _columns(data: npt.NDArray[Any], names: tuple[str, ...]) -> npt.NDArray[np.float32]:
    out = np.empty((len(data), len(names)), np.float32)
    for index, name in enumerate(names):
        out[:, index] = data[name]
    return out


def read_ply(path: Path, policy: InputPolicy | None = None) -> tuple[GaussianCloud, list[str]]:
    """The frame in `path`, and notes about what was repaired.

    InputError, naming file and property, for missing or unknown properties, values that are not finite
    and zero quaternions, unless `policy` says otherwise.
    """
    policy = policy or InputPolicy()
    data = _vertex_data(path)
    degree = _sh_degree(data.dtype.names or (), path)
    rest_names = _rest_names(degree)
    _check_properties(data, (*_REQUIRED, *rest_names), policy, path)
    if not len(data):
        raise InputError(f"{path}: no Gaussians (element vertex 0); remove the frame or use --allow-gaps")
    notes: list[str] = []
    groups = {}
    for names in (_POSITIONS, _ROTATIONS, _SCALES, ("opacity",), _SH_DC, rest_names):
        groups[names] = _finite(_columns(data, names), names, policy, path, notes)
    rotations = _nonzero(groups[_ROTATIONS], policy, path, notes)
    cloud = GaussianCloud(
        positions=groups[_POSITIONS],
        rotations=rotations,
        scales=groups[_SCALES],
        opacities=groups[("opacity",)][:, 0],
        sh_dc=groups[_SH_DC],
        sh_rest=groups[rest_names].reshape(len(data), 3, -1),
    )
    return cloud, notes


def _finite(
    values: npt.NDArray[np.float32], names: tuple[str, ...], policy: InputPolicy, path: Path, notes: list[str]
) -> npt.NDArray[np.float32]:
    finite = np.isfinite(values)
    if finite.all():
        return values
    row, column = np.argwhere(~finite)[0]
    what = (
        f"{(~finite).sum()} values of {names[0]}..{names[-1]} are NaN or infinite, "
        f"first '{names[column]}' of Gaussian {row}"
    )
    if not policy.repair:
        raise InputError(f"{path}: {what}; --repair sets them to {REPAIRED_VALUE:g}")
    notes.append(f"{path.name}: {what}; set to {REPAIRED_VALUE:g}")
    return np.where(finite, values, np.float32(REPAIRED_VALUE))


def _nonzero(
    rotations: npt.NDArray[np.float32], policy: InputPolicy, path: Path, notes: list[str]
) -> npt.NDArray[np.float32]:
    zero = (rotations == 0).all(axis=1)
    if not zero.any():
        return rotations
    what = f"{zero.sum()} quaternions rot_0..rot_3 are zero, first of Gaussian {int(zero.argmax())}"
    if not policy.repair:
        raise InputError(f"{path}: {what}; --repair sets them to no rotation (1, 0, 0, 0)")
    notes.append(f"{path.name}: {what}; set to no rotation")
    return np.where(zero[:, None], np.array(REPAIRED_QUATERNION, np.float32), rotations)


def write_ply(path: Path, cloud: GaussianCloud) -> None:
    """Write `cloud` as binary little-endian float32 PLY in the INRIA property order."""
    n = cloud.num_gaussians
    names = property_names(cloud.sh_degree)
    table = np.concatenate(
        [
            cloud.positions,
            np.zeros((n, len(_NORMALS)), np.float32),
            cloud.sh_dc,
            cloud.sh_rest.reshape(n, 3 * cloud.sh_rest.shape[2]),
            cloud.opacities[:, None],
            cloud.scales,
            cloud.rotations,
        ],
        axis=1,
    ).astype("<f4")
    vertex = table.view([(name, "<f4") for name in names])[:, 0]
    PlyData([PlyElement.describe(vertex, "vertex")], byte_order="<").write(str(path))
