"""Cameras that lie beside the frames are found where trainers leave them; the nearest first."""

from __future__ import annotations

from pathlib import Path

import pytest

from dfcgs_codec.views.read import find_views
from tests.unit.views.view_files import colmap_text, some_cameras

FLAT = ["f_0.ply", "f_1.ply"]
TREE = [f"frame_{i}/point_cloud/iteration_7000/point_cloud.ply" for i in range(2)]
MODEL = ["point_cloud/iteration_7000/point_cloud.ply"]
FILM = [f"point_cloud/iteration_{i}/point_cloud.ply" for i in (100, 200)]

#: frames, files that there are, the one that is found
SITUATIONS: dict[str, tuple[list[str], list[str], str | None]] = {
    "beside": (FLAT, ["cameras.json", "transforms.json"], "cameras.json"),
    "of nerfstudio": (FLAT, ["transforms.json"], "transforms.json"),
    "nothing": (FLAT, ["camera.json", "other/cameras.json"], None),
    "above the folder": (FLAT, ["../cameras.json"], None),
    "INRIA's model": (MODEL, ["cameras.json"], "cameras.json"),
    "a film of the training": (FILM, ["cameras.json"], "cameras.json"),
    "above the model": (MODEL, ["../cameras.json"], None),
    "one for all": (TREE, ["cameras.json"], "cameras.json"),
    "of the first frame": (TREE, [f"frame_{i}/cameras.json" for i in (1, 0)], "frame_0/cameras.json"),
    "of another frame alone": (TREE, ["frame_1/cameras.json"], None),
    "the nearest": (TREE, ["cameras.json", "frame_0/transforms.json"], "frame_0/transforms.json"),
    "above the tree": (TREE, ["../cameras.json"], None),
    "a model in each": ([f"f{i}/point_cloud.ply" for i in range(2)], ["f0/cameras.json"], "f0/cameras.json"),
}


def put(folder: Path, names: list[str]) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("[]")


@pytest.mark.parametrize("situation", SITUATIONS)
def test_where_cameras_are_found(situation: str, tmp_path: Path) -> None:
    frames, names, wanted = SITUATIONS[situation]
    scene = tmp_path / "scene"
    put(scene, [*frames, *names])
    assert find_views([scene / name for name in frames]) == (scene / wanted if wanted else None)


def test_relative_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, [*MODEL, "cameras.json"])
    monkeypatch.chdir(tmp_path / "point_cloud" / "iteration_7000")
    assert find_views([Path("point_cloud.ply")]) == tmp_path / "cameras.json"


def test_a_model_of_colmap(tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse" / "0", some_cameras())
    assert find_views([tmp_path / "a.ply"]) == tmp_path / "sparse" / "0"
    (tmp_path / "sparse" / "0" / "images.txt").unlink()
    assert find_views([tmp_path / "a.ply"]) is None


def test_a_folder_called_like_the_file_is_none(tmp_path: Path) -> None:
    (tmp_path / "cameras.json").mkdir()
    assert find_views([tmp_path / "a.ply"]) is None
    assert find_views([]) is None
