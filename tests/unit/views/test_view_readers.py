"""Cameras come out of every format as they went in."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.read import read_views
from tests.unit.views.view_files import (
    ONE_FOCAL,
    WRITERS,
    camera,
    close,
    colmap_binary,
    colmap_text,
    inria,
    some_cameras,
    transforms,
    write_json,
)


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_cameras_through_every_format(name: str, tmp_path: Path) -> None:
    wanted = some_cameras()
    path = WRITERS[name](tmp_path, wanted)
    found = read_views(path)
    assert close(found.cameras, wanted)
    assert found.path == path


@pytest.mark.parametrize("name", WRITERS)
def test_the_folder_around_them_does_as_well(name: str, tmp_path: Path) -> None:
    path = WRITERS[name](tmp_path, some_cameras())
    assert read_views(tmp_path) == read_views(path)
    assert read_views(str(path)) == read_views(bytes(path))


@pytest.mark.parametrize("place", ["sparse", "colmap/sparse/0", "."])
def test_places_of_a_colmap_model(place: str, tmp_path: Path) -> None:
    colmap_binary(tmp_path / place, some_cameras())
    assert len(read_views(tmp_path).cameras) == 3


def test_a_file_of_colmap_stands_for_its_folder(tmp_path: Path) -> None:
    colmap_text(tmp_path, some_cameras())
    assert close(read_views(tmp_path / "images.txt").cameras, some_cameras())


def test_of_two_models_of_colmap_the_binary_one_is_read(tmp_path: Path) -> None:
    colmap_text(tmp_path, some_cameras(2))
    colmap_binary(tmp_path, some_cameras(3))
    (tmp_path / "rigs.bin").write_bytes(b"of newer versions")
    assert len(read_views(tmp_path).cameras) == 3


@pytest.mark.parametrize("model", [*ONE_FOCAL, 4, 5])
def test_models_of_colmap(model: int, tmp_path: Path) -> None:
    found = read_views(colmap_binary(tmp_path, [camera()], model=model)).cameras[0]
    assert found.fx == 500
    assert found.fy == (500 if model in ONE_FOCAL else 510)
    assert (found.cx, found.cy) == (320, 240)


def test_what_is_read_shows_in_the_content(tmp_path: Path) -> None:
    path = tmp_path / "poses of the film"
    path.write_bytes(b"\xef\xbb\xbf\n" + json.dumps(inria(some_cameras())).encode())
    assert close(read_views(path).cameras, some_cameras())
    path.write_text(json.dumps(transforms(some_cameras())))
    assert close(read_views(path).cameras, some_cameras())


# --- transforms.json ----------------------------------------------------------------------------------


def transforms_with(tmp_path: Path, **intrinsics: object) -> ViewCamera:
    frames = [{"transform_matrix": np.diag([1.0, -1.0, -1.0, 1.0]).tolist()}]
    return read_views(write_json(tmp_path / "transforms.json", {"frames": frames, **intrinsics})).cameras[0]


def test_intrinsics_of_all_frames(tmp_path: Path) -> None:
    values = {"fl_x": 900, "fl_y": 910, "cx": 300.5, "cy": 200, "w": 640.0, "h": 480}
    assert transforms_with(tmp_path, **values) == ViewCamera(640, 480, 900, 910, 300.5, 200, np.eye(4))


def test_an_angle_alone_is_a_square_image(tmp_path: Path) -> None:
    found = transforms_with(tmp_path, camera_angle_x=2 * math.atan(0.5))
    assert (found.width, found.height, found.cx, found.cy) == (800, 800, 400, 400)
    assert found.fx == found.fy == pytest.approx(800)


def test_angles_and_a_size(tmp_path: Path) -> None:
    found = transforms_with(
        tmp_path, camera_angle_x=2 * math.atan(0.5), camera_angle_y=math.pi / 2, w=200, h=100
    )
    assert (found.fx, found.fy) == (pytest.approx(200), pytest.approx(50))


def test_a_missing_size_is_twice_the_principal_point(tmp_path: Path) -> None:
    found = transforms_with(tmp_path, fl_x=900, cx=320, cy=200)
    assert (found.width, found.height, found.fx, found.fy) == (640, 400, 900, 900)


def test_values_of_a_frame_come_first(tmp_path: Path) -> None:
    content = transforms(some_cameras()) | {"fl_x": 1, "w": 2}
    assert close(read_views(write_json(tmp_path / "a.json", content)).cameras, some_cameras())


def test_splats_of_nerfstudio_are_where_its_parser_put_the_cameras(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    applied = np.eye(4)
    applied[:3, :3], applied[:3, 3] = [[0, 1, 0], [1, 0, 0], [0, 0, -1]], rng.normal(size=3)
    oriented = np.eye(4)
    oriented[:3, :3], oriented[:3, 3] = camera(turn=(0.3, 0.2, 0.1)).rotation, rng.normal(size=3)
    content = transforms(some_cameras()) | {"applied_transform": applied[:3].tolist()}
    path = write_json(tmp_path / "transforms.json", content)
    assert close(read_views(path).cameras, some_cameras())
    # as nerfstudio's parser writes it: from the poses before `applied_transform`
    parser = {"transform": (oriented @ applied)[:3].tolist(), "scale": 0.25}
    write_json(tmp_path / "dataparser_transforms.json", parser)
    for before, after in zip(some_cameras(), read_views(path).cameras, strict=True):
        wanted = 0.25 * (oriented[:3, :3] @ before.position + oriented[:3, 3])
        assert np.allclose(after.position, wanted)
        assert np.allclose(after.rotation, before.rotation @ oriented[:3, :3].T)


# --- cameras ------------------------------------------------------------------------------------------


def test_a_smaller_image_of_the_same_view() -> None:
    small = camera(size=(1920, 1080), focal=(1000, 1000)).resized(96)
    assert (small.width, small.height) == (96, 54)
    assert (small.fx, small.fy, small.cx, small.cy) == pytest.approx((50, 50, 48, 27))
    assert small.resized(96) is small
    assert camera(size=(5000, 3)).resized(10).height == 1


def test_position_and_direction() -> None:
    found = camera((1, 2, 3), (0, math.pi / 2, 0))
    assert np.allclose(found.position, (1, 2, 3))
    assert np.allclose(found.forward, (1, 0, 0))
    assert np.allclose(found.moved_to(np.array([4.0, 5.0, 6.0])).position, (4, 5, 6))


def test_cameras_are_values() -> None:
    first, again = camera((1, 2, 3)), camera((1, 2, 3))
    assert first == again
    assert hash(first) == hash(again)
    assert first != replace(first, fx=1)
    assert pickle.loads(pickle.dumps(Views((first,), Path("a.json")))) == Views((again,), Path("a.json"))
    with pytest.raises(ValueError, match="read-only"):
        first.world_to_camera[0, 0] = 2
