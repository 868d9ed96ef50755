"""Standard 3DGS PLY files, by plyfile; private to the generator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from plyfile import PlyData, PlyElement

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud


def property_names(sh_degree: int) -> list[str]:
    """Properties in the order of INRIA's files."""
    rest = [f"f_rest_{i}" for i in range(3 * SH_REST_COEFFICIENTS[sh_degree])]
    head = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    return [*head, *rest, "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]


def write_ply(cloud: GaussianCloud, path: Path) -> None:
    """Binary little endian float32; normals are zero."""
    n = cloud.num_gaussians
    columns = [
        cloud.positions,
        np.zeros((n, 3), np.float32),
        cloud.sh_dc,
        cloud.sh_rest.reshape(n, 3 * cloud.sh_rest.shape[2]),
        cloud.opacities[:, None],
        cloud.scales,
        cloud.rotations,
    ]
    table = np.concatenate(columns, axis=1).astype("<f4")
    dtype = np.dtype([(name, "<f4") for name in property_names(cloud.sh_degree)])
    element = PlyElement.describe(table.view(dtype)[:, 0], "vertex")
    PlyData([element], byte_order="<").write(str(path))


def read_ply(path: Path) -> GaussianCloud:
    """Raises InputError where a property of a 3DGS file is missing."""
    data = PlyData.read(str(path))["vertex"].data
    found = set(data.dtype.names)
    per_channel = sum(name.startswith("f_rest_") for name in found) // 3
    if per_channel not in SH_REST_COEFFICIENTS:
        raise InputError(f"{path}: {3 * per_channel} f_rest properties, expected 0, 9, 24 or 45")
    names = property_names(SH_REST_COEFFICIENTS.index(per_channel))
    missing = [name for name in names if name not in found and name[0] != "n"]
    if missing:
        raise InputError(f"{path}: property {missing[0]} is missing; not a 3DGS file")

    def columns(*wanted: str) -> npt.NDArray[np.float32]:
        out = np.empty((len(data), len(wanted)), np.float32)
        for index, name in enumerate(wanted):
            out[:, index] = data[name]
        return out

    rest = columns(*(name for name in names if name.startswith("f_rest_")))
    return GaussianCloud(
        positions=columns("x", "y", "z"),
        rotations=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        scales=columns("scale_0", "scale_1", "scale_2"),
        opacities=data["opacity"].astype(np.float32),
        sh_dc=columns("f_dc_0", "f_dc_1", "f_dc_2"),
        sh_rest=rest.reshape(len(data), 3, per_channel),
    )
