"""Files that are no cameras: one line that names the file, what was found and what was expected."""

from __future__ import annotations

import copy
import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import InputError
from dfcgs_codec.views import fields
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.read import read_views
from tests.unit.views.view_files import (
    camera,
    colmap_binary,
    colmap_text,
    inria,
    some_cameras,
    transforms,
    write_json,
)


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_views(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400 + len(str(path))
    return message


def without(record: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key != name}


FLIPPED = np.diag([1.0, 1.0, -1.0]).tolist()
SLANTED = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]
ZEROS = [[0] * 3] * 3

#: what to change in the second camera of a `cameras.json`, and words of the message
CHANGED: dict[str, tuple[dict[str, Any], list[str]]] = {
    "no width": ({"width": 0}, ["width: found 0", "1 to 1048576"]),
    "a width below 0": ({"width": -640}, ["width: found -640"]),
    "half a pixel": ({"height": 480.5}, ["height: found 480.5", "a whole number"]),
    "a text": ({"width": "640"}, ["width: found '640' (str)"]),
    "a huge width": ({"width": 10**400}, ["width: found", "expected a number"]),
    "no focal length": ({"fx": 0}, ["fx: found 0", "above 0"]),
    "NaN": ({"fy": float("nan")}, ["fy: found nan"]),
    "infinite": ({"position": [0, float("inf"), 0]}, ["position: found inf", "a finite number"]),
    "huge": ({"position": [0, 1e200, 0]}, ["position: found 1e+200", "below 1e+15"]),
    "two numbers": ({"position": [0, 0]}, ["position: found [0, 0] (list)", "3 numbers"]),
    "no list": ({"position": None}, ["position: found None"]),
    "a flat matrix": ({"rotation": [0] * 9}, ["rotation", "3 x 3 numbers"]),
    "a reflection": ({"rotation": FLIPPED}, ["a reflection (determinant -1)", "expected a rotation"]),
    "slanted": ({"rotation": SLANTED}, ["0.1 off the identity", "expected a rotation"]),
    "zeros": ({"rotation": ZEROS}, ["1 off the identity"]),
}


@pytest.mark.parametrize("situation", CHANGED)
def test_values_that_are_no_cameras(situation: str, tmp_path: Path) -> None:
    values, words = CHANGED[situation]
    content = inria(some_cameras())
    content[1] |= values
    path = write_json(tmp_path / "cameras.json", content)
    message = refusal(path)
    for word in [f"{path}: camera 1: ", *words]:
        assert word in message


@pytest.mark.parametrize("name", ["width", "height", "position", "rotation", "fx", "fy"])
def test_missing_keys_are_named(name: str, tmp_path: Path) -> None:
    content = [without(record, name) for record in inria(some_cameras())]
    message = refusal(write_json(tmp_path / "cameras.json", content))
    assert f"camera 0: found no {name}, expected an object with width" in message


def changed(frame: dict[str, Any] | None = None, **values: Any) -> dict[str, Any]:
    content = copy.deepcopy(transforms([camera()]))
    content["frames"][0] |= frame or {}
    return {key: value for key, value in (content | values).items() if value is not None}


#: what a file holds, and words of the message
CONTENT: dict[str, tuple[object, list[str]]] = {
    "an empty list": ([], ["found 0 cameras, expected 1 to"]),
    "numbers": ([1, 2], ["camera 0: found a int, expected an object with width"]),
    "another object": ({"a": 1}, ["found no frames"]),
    "no frames": (changed(frames=[]), ["found 0 frames"]),
    "frames of another kind": (changed(frames={}), ["frames: found a dict, expected a list"]),
    "no pose": (changed(frames=[{}]), ["frame 0: found no transform_matrix"]),
    "a small pose": (changed({"transform_matrix": SLANTED}), ["transform_matrix", "3 x 4 or 4 x 4 numbers"]),
    "no intrinsics": (
        {"frames": [{"transform_matrix": np.eye(4).tolist()}]},
        ["frame 0: found neither fl_x with w or cx, nor camera_angle_x"],
    ),
    "an angle of degrees": (
        {"frames": [{"transform_matrix": np.eye(4).tolist()}], "camera_angle_x": 60},
        ["camera_angle_x: found 60", "radians"],
    ),
    "no size": (changed({"w": 0}), ["frame 0: width: found 0"]),
    "no focal length": (changed({"fl_y": 0}), ["frame 0: fy: found 0"]),
}


@pytest.mark.parametrize("situation", CONTENT)
def test_json_that_holds_no_cameras(situation: str, tmp_path: Path) -> None:
    content, words = CONTENT[situation]
    path = write_json(tmp_path / "a.json", content)
    message = refusal(path)
    for word in [f"{path}: ", *words]:
        assert word in message


#: bytes of a file, and words of the message
BYTES: dict[str, tuple[bytes, list[str]]] = {
    "nothing": (b"", ["an empty file"]),
    "white space": (b" \n", ["an empty file"]),
    "a ply": (b"ply\nformat", ["no JSON text", "cameras.json, transforms.json or a folder of COLMAP"]),
    "cut": (b'[\n{"id": 0,', ["JSON that is broken in line 2"]),
    "a number": (b"[" + b"9" * 5000 + b"]", ["no JSON text"]),
    "deep": (b"[" * 200_000, ["no JSON text"]),
    "no utf-8": (b'["\xff\xfe\x00"]', ["no JSON text"]),
}


@pytest.mark.parametrize("situation", BYTES)
def test_files_that_are_no_json(situation: str, tmp_path: Path) -> None:
    content, words = BYTES[situation]
    path = tmp_path / "cameras.json"
    path.write_bytes(content)
    message = refusal(path)
    for word in [f"{path}: found ", "expected" if situation != "cut" else "broken", *words]:
        assert word in message


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_json(tmp_path / "cameras.json", inria(some_cameras()))
    monkeypatch.setattr(fields, "MAX_JSON_BYTES", 100)
    assert "found more than" in refusal(path)


def test_paths_without_cameras(tmp_path: Path) -> None:
    assert f"{tmp_path / 'none'}: cannot be read (No such file" in refusal(tmp_path / "none")
    assert f"{tmp_path}: found a folder without cameras, expected cameras.json" in refusal(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    assert "found a pipe or a device" in refusal(tmp_path / "pipe")
    (tmp_path / "cameras.bin").write_bytes(bytes(8))
    assert "one of COLMAP's files alone" in refusal(tmp_path / "cameras.bin")
    with pytest.raises(InputError, match="views: found 3"):
        read_views(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("parser", "word"),
    [
        ({"scale": 1}, "found no transform"),
        ({"transform": np.eye(4).tolist(), "scale": 0}, "scale: found 0, expected a number above 0"),
        ({"transform": [[1]], "scale": 1}, "transform: found"),
    ],
)
def test_a_bad_file_of_the_parser_is_named(parser: object, word: str, tmp_path: Path) -> None:
    path = write_json(tmp_path / "transforms.json", transforms(some_cameras()))
    write_json(tmp_path / "dataparser_transforms.json", parser)
    assert f"{path}: dataparser_transforms.json: {word}" in refusal(path)


# --- COLMAP -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_every_shorter_file_of_colmap_is_refused(name: str, tmp_path: Path) -> None:
    whole = (colmap_binary(tmp_path, some_cameras()) / name).read_bytes()
    for size in range(len(whole)):
        (tmp_path / name).write_bytes(whole[:size])
        assert f"{tmp_path / name}: " in refusal(tmp_path)


def absurd(layout: str, at: int, value: int, name: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        data = bytearray((folder / name).read_bytes())
        struct.pack_into(layout, data, at, value)
        (folder / name).write_bytes(data)

    return write


#: what is done to the files, the file that is named, and words of the message
DAMAGED: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "more cameras": (absurd("<Q", 0, 1 << 60, "cameras.bin"), "cameras.bin", "cameras, expected 1 to 131072"),
    "a few more": (absurd("<Q", 0, 4, "cameras.bin"), "cameras.bin", "ends 24 bytes too early"),
    "no images": (absurd("<Q", 0, 0, "images.bin"), "images.bin", "found 0 images"),
    "points": (absurd("<Q", 82, 1 << 61, "images.bin"), "images.bin", "too early"),
    "a model": (absurd("<i", 12, 17, "cameras.bin"), "cameras.bin", "camera model number 17"),
    "a width": (absurd("<Q", 16, 1 << 50, "cameras.bin"), "images.bin", "image 0: width: found 1.1259e+15"),
    "an unknown camera": (
        absurd("<i", 8, 99, "cameras.bin"),
        "images.bin",
        "image 0: found the camera number 7",
    ),
}


@pytest.mark.parametrize("situation", DAMAGED)
def test_damaged_files_of_colmap(situation: str, tmp_path: Path) -> None:
    damage, name, word = DAMAGED[situation]
    damage(colmap_binary(tmp_path, some_cameras()))
    tracemalloc.start()
    message = refusal(tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert f"{tmp_path / name}: " in message
    assert word in message
    assert peak < 1 << 20


#: file, text in place of another, words of the message
LINES = {
    "a model": ("cameras.txt", "PINHOLE", "EQUIRECTANGULAR", "the camera model EQUIRECTANGULAR"),
    "parameters": ("cameras.txt", "PINHOLE", "OPENCV", "4 parameters of OPENCV, expected 8"),
    "a width": ("cameras.txt", " 640 ", " wide ", "expected numbers"),
    "a short line": ("cameras.txt", "7 PINHOLE", "7 #", "found the camera model #"),
    "words": ("images.txt", "00000.jpg", "00000.jpg\n\n1 2 3 4", "expected a number, a quaternion"),
}


@pytest.mark.parametrize("situation", LINES)
def test_damaged_texts_of_colmap(situation: str, tmp_path: Path) -> None:
    name, old, new, word = LINES[situation]
    path = colmap_text(tmp_path, some_cameras()) / name
    path.write_text(path.read_text().replace(old, new, 1))
    message = refusal(tmp_path)
    assert f"{path}: " in message
    assert word in message


def test_a_quaternion_of_zeros(tmp_path: Path) -> None:
    colmap_text(tmp_path, [camera()])
    (tmp_path / "images.txt").write_text("1 0 0 0 0 1 2 3 7 a.jpg\n\n")
    assert "images.txt: found a quaternion of length 0" in refusal(tmp_path)


# --- Python -------------------------------------------------------------------------------------------


def test_cameras_of_python_are_checked() -> None:
    for values, word in (
        ((640, 480, 1, 1, 0, 0, np.eye(3)), "world_to_camera: found the shape"),
        ((640, 480, 1, 1, 0, 0, "a"), "world_to_camera: found 'a'"),
        ((640, 480, 1, 1, 0, 0, np.diag([1, 1, 1, 2.0])), "the last row"),
        ((640, 480, 1, 1, np.nan, 0, np.eye(4)), "cx: found nan"),
    ):
        with pytest.raises(InputError, match=word):
            ViewCamera(*values)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no camera"):
        Views(())
    with pytest.raises(InputError, match="camera 1: found 3"):
        Views((camera(), 3))  # type: ignore[arg-type]
