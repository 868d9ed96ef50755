"""Scenes of the frozen list as folders of PLY frames on disk, made once and kept under `out/bench`."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply, write_ply
from evaluation.baselines.method import SequenceFacts, frame_path, frame_paths
from lab.assets import find_asset
from lab.record import REPOSITORY
from lab.scenes.catalogue import Scene

WORK = REPOSITORY / "out" / "bench"
IDS = "ids.npz"
_FACTS = "facts.json"


@dataclass(frozen=True)
class Sequence:
    """Frames on disk. digest: SHA-256 over all frames, so that cached figures know their input."""

    name: str
    folder: Path
    facts: SequenceFacts
    digest: str

    def frame(self, index: int) -> GaussianCloud:
        """Frame `index`."""
        return read_ply(frame_path(self.folder, index))[0]


def _write(scene: Scene, num_frames: int, folder: Path) -> Iterator[GaussianCloud]:
    ids = {}
    for index, (cloud, identities) in enumerate(scene.frames_with_ids(find_asset(scene.asset))):
        if index == num_frames:
            break
        write_ply(frame_path(folder, index), cloud)
        if identities is not None:
            ids[f"ids_{index:04d}"] = identities
        yield cloud
    if ids:
        np.savez_compressed(folder / IDS, **ids)


def _digest(folder: Path) -> str:
    total = hashlib.sha256()
    for path in frame_paths(folder):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def materialise(scene: Scene, num_frames: int | None = None) -> Sequence:
    """The first `num_frames` frames (all by default) of a scene, written unless they are there.

    Raises FileNotFoundError where the scene's asset is not on this machine.
    """
    count = scene.num_frames if num_frames is None else min(num_frames, scene.num_frames)
    folder = WORK / "frames" / f"{scene.name}_{count}"
    if not (folder / _FACTS).exists():
        find_asset(scene.asset)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        clouds = [(cloud.num_gaussians, cloud.sh_degree) for cloud in _write(scene, count, folder)]
        facts = {
            "num_gaussians": [n for n, _ in clouds],
            "sh_degree": clouds[0][1],
            "digest": _digest(folder),
        }
        (folder / _FACTS).write_text(json.dumps(facts))
    stored = json.loads((folder / _FACTS).read_text())
    numbers = tuple(stored["num_gaussians"])
    return Sequence(
        scene.name, folder, SequenceFacts(len(numbers), numbers, stored["sh_degree"]), stored["digest"]
    )
