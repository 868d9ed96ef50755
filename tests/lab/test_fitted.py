"""Stored fitted sequences: the format, and those that are part of the repository."""

from __future__ import annotations

import dataclasses
import hashlib
import lzma
import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import fitted_sequence
from lab.scenes.fitted import read_about, stepped
from lab.scenes.stress import blob_cloud
from training.fitting.store import append_step, create, step_between

FOLDER = Path(__file__).resolve().parents[2] / "assets" / "fitted"
NAMES = [f.name for f in dataclasses.fields(GaussianCloud)]
STATIC = ["scales", "opacities", "sh_dc", "sh_rest"]
#: SHA-256 of all arrays of all frames: the sequences are measured and trained on, so they must not change
DIGESTS = {
    "fitted_barbarian": "3aa59a88e10c806b30cd1f1f21014537b5da1d7c534b91c464607cd306e6aed0",
    "fitted_mage": "66f1244c17ef7deedb8c107449d5f3f4616cd0de0344e800fd3893fe8b5139a0",
    "capture_kitchen": "9acf1e5212b43f4ebe37ccec020d93983cf487a37bd2cdd615b0e8c943937b8d",
    "capture_living_room": "f64f2246f46d8d7f275629348b295db1b355133b3d0d58b776271c1018733485",
    "capture_dungeon": "2a3cf891d91711339e84d3c6077fdc0dd179cee2022f3175a66d4eb3967564fe",
    "capture_bedroom": "64d462b8a01d55b3b0c2e585bb8ebf0325c24c53297ad82df004ec4f8a418959",
    "capture_street": "ad852ff05171ca59279a164113ba239cded867af66352124fd1c6bbb3750b96e",
}


def digest(frames: list[GaussianCloud]) -> str:
    state = hashlib.sha256()
    for frame in frames:
        for name in NAMES:
            state.update(getattr(frame, name).astype("<f4").tobytes())
    return state.hexdigest()


def is_capture(name: str) -> bool:
    return name.startswith("capture_")


def same(a: GaussianCloud, b: GaussianCloud) -> bool:
    return all(getattr(a, n).tobytes() == getattr(b, n).tobytes() for n in NAMES)


def jittered(cloud: GaussianCloud, rows: np.ndarray, seed: int) -> GaussianCloud:
    rng = np.random.default_rng(seed)
    arrays = {}
    for name in ("positions", "rotations"):
        arrays[name] = getattr(cloud, name).copy()
        arrays[name][rows] += rng.normal(0.0, 0.01, (len(rows), arrays[name].shape[1])).astype(np.float32)
    return dataclasses.replace(cloud, **arrays)


@pytest.fixture(scope="module", params=DIGESTS)
def stored(request: pytest.FixtureRequest) -> tuple[str, list[GaussianCloud]]:
    return request.param, list(fitted_sequence(FOLDER / f"{request.param}.zip"))


class TestStored:
    def test_shapes(self, stored: tuple[str, list[GaussianCloud]]) -> None:
        name, frames = stored
        assert len(frames) == 20
        ((count, degree),) = {(f.num_gaussians, f.sh_degree) for f in frames}
        if is_capture(name):
            # a fit that was given 30 000 may have dropped some that showed nothing
            assert 28_000 <= count <= 60_000
        else:
            assert (count, degree) == (19_000, 1)
        assert all(np.isfinite(getattr(f, n)).all() for f in frames for n in NAMES)

    def test_only_positions_and_rotations_change(self, stored: tuple[str, list[GaussianCloud]]) -> None:
        _, frames = stored
        for a, b in pairwise(frames):
            assert all(getattr(a, n).tobytes() == getattr(b, n).tobytes() for n in STATIC)

    def test_statistics_are_those_of_a_tracker(self, stored: tuple[str, list[GaussianCloud]]) -> None:
        name, frames = stored
        for a, b in pairwise(frames):
            still = (a.positions == b.positions).all(axis=1)
            # most of a room is far from the one who moves in it
            low, high = (0.6, 0.995) if is_capture(name) else (0.3, 0.8)
            assert low < still.mean() < high
            assert (a.rotations == b.rotations)[still].mean() > 0.99
            step = np.linalg.norm(b.positions - a.positions, axis=1)[~still]
            assert 1e-3 < np.median(step) < 0.1

    def test_frames_are_those_that_were_stored(self, stored: tuple[str, list[GaussianCloud]]) -> None:
        name, frames = stored
        assert digest(frames) == DIGESTS[name]


class TestFormat:
    @pytest.fixture
    def first(self) -> GaussianCloud:
        return blob_cloud(301, 1, seed=4)

    def test_round_trip(self, tmp_path: Path, first: GaussianCloud) -> None:
        path = tmp_path / "blob.zip"
        create(path, first, {"seed": 4})
        expected = [first]
        for index, rows in enumerate((np.arange(0, 301, 7), np.arange(0), np.arange(301)), start=1):
            found, steps = step_between(expected[-1], jittered(expected[-1], rows, index))
            assert np.array_equal(found, rows)
            append_step(path, index, found, steps)
            expected.append(stepped(expected[-1], found, steps))
        frames = list(fitted_sequence(path))
        assert len(frames) == 4
        assert all(same(a, b) for a, b in zip(frames, expected, strict=True))
        assert read_about(path)["source"] == {"seed": 4}

    def test_a_stored_step_is_near_the_true_one(self, first: GaussianCloud) -> None:
        rows = np.arange(0, 301, 3)
        moved = jittered(first, rows, 1)
        stored = stepped(first, *step_between(first, moved))
        for name in ("positions", "rotations"):
            before, true, found = (getattr(cloud, name) for cloud in (first, moved, stored))
            # nine significant bits of the step and one rounding of the sum, both rounded up
            bound = np.abs(true - before) * 2.0**-8 + np.spacing(np.abs(true)) + 1e-7
            assert (np.abs(found - true) <= bound).all()
            assert np.array_equal(np.delete(found, rows, 0), np.delete(before, rows, 0))

    def test_equal_sequences_are_equal_files(self, tmp_path: Path, first: GaussianCloud) -> None:
        for name in ("a", "b"):
            create(tmp_path / name, first, {})
            append_step(tmp_path / name, 1, *step_between(first, jittered(first, np.arange(9), 1)))
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()

    @pytest.mark.parametrize("damage", ["missing", "cut", "flipped", "no zip", "member lost", "version"])
    def test_a_bad_file_is_refused(self, tmp_path: Path, first: GaussianCloud, damage: str) -> None:
        path = tmp_path / "blob.zip"
        create(path, first, {})
        whole = path.read_bytes()
        if damage == "missing":
            path.unlink()
        elif damage == "cut":
            path.write_bytes(whole[: len(whole) // 2])
        elif damage == "flipped":
            middle = len(whole) // 2
            path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :])
        elif damage == "no zip":
            path.write_text("no archive\n")
        else:
            with zipfile.ZipFile(path) as archive:
                members = {name: archive.read(name) for name in archive.namelist()}
            if damage == "member lost":
                del members["first"]
            else:
                members["about"] = lzma.compress(b'{"version": 2}')
            with zipfile.ZipFile(path, "w") as archive:
                for name, data in members.items():
                    archive.writestr(name, data)
        with pytest.raises(InputError, match=r"blob\.zip"):
            list(fitted_sequence(path))
