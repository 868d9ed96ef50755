"""Frames of a folder as Gaussians, and the checks of pinned packages that all methods share."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from importlib import metadata
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation, plan_quantisation
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply, write_ply
from evaluation.baselines.method import MethodRefused, MethodUnavailable, frame_path, frame_paths


def read_frames(folder: Path) -> Iterator[GaussianCloud]:
    """The frames of a folder in order; MethodRefused for a frame that is not a plain 3DGS PLY."""
    for path in frame_paths(folder):
        try:
            yield read_ply(path)[0]
        except InputError as error:
            raise MethodRefused(str(error)) from error


def write_frames(folder: Path, frames: Iterable[GaussianCloud]) -> None:
    """Write frame_0000.ply, frame_0001.ply ... into an existing folder."""
    for index, cloud in enumerate(frames):
        write_ply(frame_path(folder, index), cloud)


def pinned(requirement: str) -> str:
    """`requirement` ("package==version") if that is what is installed, else MethodUnavailable."""
    name, version = requirement.split("==")
    try:
        installed = metadata.version(name)
    except metadata.PackageNotFoundError:
        raise MethodUnavailable(f"{name} is missing: pip install {requirement}") from None
    if installed != version:
        raise MethodUnavailable(f"found {name} {installed}: pip install {requirement}")
    return requirement


def concatenated(clouds: Sequence[GaussianCloud]) -> GaussianCloud:
    """All Gaussians of several clouds of one SH degree, one cloud after the other."""
    names = [field.name for field in fields(GaussianCloud)]
    return GaussianCloud(*(np.concatenate([getattr(c, name) for c in clouds]) for name in names))


def identities(folder: Path, clouds: Sequence[GaussianCloud]) -> list[Int64]:
    """True identity (N,) of each Gaussian of each frame: `ids.npz`, else the index where N is constant.

    `ids.npz` holds ids_0000, ids_0001, ...; MethodRefused where there is none and N changes.
    """
    path = folder / "ids.npz"
    if path.exists():
        with np.load(path) as arrays:
            return [arrays[f"ids_{index:04d}"].astype(np.int64) for index in range(len(clouds))]
    if len({cloud.num_gaussians for cloud in clouds}) > 1:
        raise MethodRefused(f"needs to know which Gaussian is which: N changes and {path.name} is missing")
    return [np.arange(cloud.num_gaussians) for cloud in clouds]


def planned(qp: float, first: GaussianCloud) -> Quantisation:
    """The codec's own grids and steps at `qp` for a sequence that begins with `first`."""
    return plan_quantisation(qp, (), first)


def planned_version() -> str:
    """Changes when the codec's steps do, which decide the bytes of the methods that borrow them."""
    scales = np.linspace(-9.0, -3.0, 15, dtype=np.float32).reshape(5, 3)
    one = np.ones((5, 4), np.float32)
    cloud = GaussianCloud(one[:, :3], one, scales, one[:, 0], one[:, :3], np.zeros((5, 3, 0), np.float32))
    plans = [planned(qp, cloud) for qp in (16, 22, 28, 34)]
    numbers = repr([(plan.units, sorted(plan.steps.items())) for plan in plans]).encode()
    return f"steps {hashlib.blake2b(numbers, digest_size=4).hexdigest()}"
