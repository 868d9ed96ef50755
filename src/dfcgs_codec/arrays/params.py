"""The params.npz that Dynamic 3D Gaussians leaves: a sequence in one file, each timestep a frame.

    means3D           (T, N, 3)   scene units
    unnorm_rotations  (T, N, 4)   quaternion w, x, y, z, of any length but zero
    rgb_colors        (T, N, 3)   0 to 1: SH degree 0
    logit_opacities   (N, 1)      logit of alpha
    log_scales        (N, 3)      natural logarithm; or (N, 1), for round Gaussians

Each of them may be for all timesteps, without T, or one for each. Numbers are floats of 16, 32 or 64 bits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.arrays.archive import Archive, Member, open_archive
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply.policy import InputPolicy, PlyHeader, shortened
from dfcgs_codec.ply.read import SH_C0
from dfcgs_codec.ply.repair import check_values

#: how the file is called, and the ending that such files have
FILE_NAME, ENDING = "params.npz", ".npz"
#: array -> the attribute that it is, and the lengths that its last axis may have
_ARRAYS = {
    "means3D": ("positions", (3,)),
    "unnorm_rotations": ("rotations", (4,)),
    "rgb_colors": ("sh_dc", (3,)),
    "logit_opacities": ("opacities", (1,)),
    "log_scales": ("scales", (3, 1)),
}
#: what tracking leaves beside them that is no part of a frame: segments, cameras and their exposures
_NO_PART = frozenset(
    (
        *("seg_colors", "cam_m", "cam_c", "cam_unnorm_rots", "cam_trans", "timestep", "intrinsics", "w2c"),
        *("org_width", "org_height", "gt_w2c_all_frames", "keyframe_time_indices"),
    )
)
_EXPECTED = "expected means3D (T, N, 3), unnorm_rotations (T, N, 4), rgb_colors (T, N, 3), "
_EXPECTED += "logit_opacities (N, 1) and log_scales (N, 3), as Dynamic 3D Gaussians saves them"


@dataclass(frozen=True)
class TimestepSource:
    """The timesteps of a params.npz as frames, numbered from 0, read when asked for (a FrameSource)."""

    archive: Archive
    num_timesteps: int
    num_gaussians: int
    policy: InputPolicy
    notes: list[str] = field(default_factory=list)

    @property
    def paths(self) -> list[Path]:
        """The one file that is read."""
        return [self.archive.path]

    @property
    def numbers(self) -> list[int]:
        """0, 1, 2, ..."""
        return list(range(self.num_timesteps))

    @property
    def headers(self) -> list[PlyHeader]:
        """Gaussians and SH degree, 0, of each timestep."""
        return [PlyHeader(self.num_gaussians, 0)] * self.num_timesteps

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        """Timestep `index`, and notes about repairs; InputError for values that `policy` does not allow."""
        self.archive.check_unchanged()
        groups = {attribute: self._values(name, index) for name, (attribute, _) in _ARRAYS.items()}
        groups["sh_dc"] = _sh_dc(groups["sh_dc"])
        groups["scales"] = np.repeat(groups["scales"], 3 // groups["scales"].shape[1], axis=1)
        groups["sh_rest"] = np.zeros((self.num_gaussians, 0), np.float32)
        return self._checked(groups, index)

    def _values(self, name: str, index: int) -> AnyArray:
        per_timestep = len(self.archive.members[name].shape) == 3
        values = self.archive.read(name, index if per_timestep else None)
        return values.astype(np.float64 if values.dtype == np.float64 else np.float32, copy=False)

    def _checked(self, groups: dict[str, AnyArray], index: int) -> tuple[GaussianCloud, list[str]]:
        path, notes = self.archive.path, []
        if self.policy.repair:
            notes = check_values(groups, _names(), f"timestep {index} of {path.name}", repair=True)
        elif not self.policy.keep_bits:
            check_values(groups, _names(), f"{path}, timestep {index}", repair=False)
        groups["opacities"] = groups["opacities"][:, 0]
        groups["sh_rest"] = groups["sh_rest"].reshape(self.num_gaussians, 3, 0)
        return GaussianCloud(**groups), notes


def _sh_dc(colours: AnyArray) -> AnyArray:
    wide = (colours.astype(np.float64) - 0.5) / SH_C0
    return wide.astype(colours.dtype)


def _names() -> dict[str, tuple[str, ...]]:
    """What single values are called in messages."""
    names = {
        attribute: tuple(f"{name}[{i}]" for i in range(widths[0]))
        for name, (attribute, widths) in _ARRAYS.items()
    }
    return names | {"sh_rest": ()}


def params_in(folder: Path) -> Path | None:
    """The params.npz of a folder, or None."""
    path = folder / FILE_NAME
    return path if path.is_file() else None


def open_params(path: Path, policy: InputPolicy | None = None) -> TimestepSource:
    """The timesteps of the .npz at `path`.

    InputError for missing arrays, those of other shapes or types, pickles, and unknown arrays unless
    `policy.drop_extra`; the message says what was expected.
    """
    policy = policy or InputPolicy()
    archive = open_archive(path)
    missing = [name for name in _ARRAYS if name not in archive.members]
    if missing:
        found = f" (there are {shortened(list(archive.members))})" if archive.members else ""
        raise InputError(f"{path}: no array {missing[0]}{found}; {_EXPECTED}")
    timesteps, gaussians = _counts(archive)
    for name in _ARRAYS:
        _check(archive.members[name], timesteps, gaussians, path)
    notes = _left_out(archive, policy)
    notes.insert(
        0, f"{path.name}: {timesteps} timesteps of {gaussians} Gaussians, as Dynamic 3D Gaussians saves them"
    )
    return TimestepSource(archive, timesteps, gaussians, policy, notes)


def _counts(archive: Archive) -> tuple[int, int]:
    """T and N, as the first array has them that has a T; T is 1 where none has one."""
    shapes = [archive.members[name].shape for name in _ARRAYS]
    varying = [shape for shape in shapes if len(shape) == 3]
    if not varying:
        return 1, shapes[0][0] if shapes[0] else 0
    if not varying[0][0]:
        raise InputError(f"{archive.path}: 0 timesteps; {_EXPECTED}, with T of 1 or more")
    return varying[0][0], varying[0][1]


def _check(member: Member, timesteps: int, gaussians: int, path: Path) -> None:
    """InputError for an array of another shape or type than `_ARRAYS` and the others have it."""
    _, widths = _ARRAYS[member.name]
    shapes = [(gaussians, width) for width in widths]
    allowed = [*shapes, *((timesteps, *shape) for shape in shapes)]
    if member.dtype.kind != "f" or member.dtype.itemsize > 8 or member.shape not in allowed:
        choice = " or ".join(map(str, allowed[:: len(widths)]))
        raise InputError(
            f"{path}: {member.name} is {member.dtype} {member.shape}, expected float32 or float64 {choice}: "
            f"{timesteps} timesteps of {gaussians} Gaussians"
        )
    if member.by_column and len(member.shape) == 3:
        raise InputError(
            f"{path}: {member.name} is saved in Fortran order, in which timesteps cannot be read one by one; "
            "save it again as numpy.ascontiguousarray"
        )


def _left_out(archive: Archive, policy: InputPolicy) -> list[str]:
    others = [name for name in archive.members if name not in _ARRAYS]
    unknown = [name for name in others if name not in _NO_PART]
    if unknown and not policy.drop_extra:
        raise InputError(
            f"{archive.path}: arrays that the codec does not keep: {shortened(unknown)}; --drop-extra "
            "encodes without them"
        )
    return [f"{archive.path.name}: left out: {shortened(others)}"] if others else []
