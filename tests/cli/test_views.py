"""`--views`: cameras beside the frames are found and told, those that are named are read or refused."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions, InputError, encode_sequence, probe
from dfcgs_codec.views.camera import Views
from lab.options import encoder_options
from lab.small_clouds import drifting, make_cloud
from lab.small_room import room, viewers
from tests.helpers import dfcgs, write_frames
from tests.unit.views.view_files import colmap_binary, inria, some_cameras, write_json

FRAMES = drifting(make_cloud(30), 2)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Two frames with a `cameras.json` of three cameras beside."""
    write_frames(tmp_path / "scene", FRAMES)
    write_json(tmp_path / "scene" / "cameras.json", inria(some_cameras()))
    return tmp_path / "scene"


def encode(scene: Path, *options: str | Path) -> subprocess.CompletedProcess[str]:
    return dfcgs("encode", scene, scene.parent / "out.dgs", "--jobs", "1", *options)


def settings(scene: Path) -> str:
    return probe(scene.parent / "out.dgs").encoder_info


def test_cameras_beside_the_frames_are_found_and_told(scene: Path) -> None:
    done = encode(scene, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "note: views: 3 cameras of cameras.json\n"
    assert json.loads(done.stdout)["notes"] == ["views: 3 cameras of cameras.json"]
    assert " views=3/0.15" in settings(scene)


def test_a_model_of_colmap_beside_the_frames(scene: Path) -> None:
    (scene / "cameras.json").unlink()
    colmap_binary(scene / "sparse" / "0", some_cameras(1))
    done = encode(scene)
    assert done.stderr == "note: views: 1 camera of sparse/0\n"


def test_none_is_none(scene: Path) -> None:
    done = encode(scene, "--views", "none", "--keep-unseen")
    assert (done.returncode, done.stderr) == (0, "")
    assert "views" not in settings(scene)
    assert settings(scene).count("keep_unseen") == 1


def test_named_ones_come_first(scene: Path) -> None:
    path = write_json(scene.parent / "others.json", inria(some_cameras(2)))
    done = encode(scene, "--views", path, "--views-margin", "0.3", "--keep-unseen")
    assert done.stderr == "note: views: 2 cameras of others.json\n"
    assert "views=2/0.3 keep_unseen" in settings(scene)
    assert str(scene.parent) not in settings(scene)


def test_bad_ones_that_are_found_stop_nothing(scene: Path) -> None:
    (scene / "cameras.json").write_text("[]")
    done = encode(scene)
    assert done.returncode == 0
    assert done.stderr.startswith(
        "note: cameras.json was found beside the frames and is not used: found 0 cameras, expected 1 to"
    )
    assert len(done.stderr.splitlines()) == 1
    assert "views" not in settings(scene)


@pytest.mark.parametrize("content", [None, "[]", '[{"width": 1}]', "no json"])
def test_bad_ones_that_are_named_stop_it(content: str | None, scene: Path) -> None:
    path = scene.parent / "bad.json"
    if content is not None:
        path.write_text(content)
    done = encode(scene, "--views", path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith(f"dfcgs: {path}: ")
    assert done.stderr.endswith(" [input]\n")
    assert len(done.stderr.splitlines()) == 1
    assert not (scene.parent / "out.dgs").exists()


def test_profile_paper_has_no_use_for_them(scene: Path) -> None:
    out = scene.parent / "out.dgs"
    done = dfcgs("encode", scene, out, "--jobs", "1", "--profile", "paper", "--gof-size", "1")
    assert (done.returncode, done.stderr) == (0, "")
    done = dfcgs("encode", scene, out, "--force", "--profile", "paper", "--views", scene / "cameras.json")
    assert done.returncode == 1
    assert "--views and --keep-unseen belong to --profile main" in done.stderr


@pytest.mark.parametrize("margin", ["-0.1", "11", "nan"])
def test_a_margin_out_of_range(margin: str, scene: Path) -> None:
    done = encode(scene, "--views-margin", margin)
    assert done.returncode == 1
    assert "--views-margin" in done.stderr


def test_views_go_to_worker_processes(scene: Path) -> None:
    done = encode(scene, "--jobs", "2", "--gof-size", "1")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "note: views: 3 cameras of cameras.json\n"


def test_python_reads_a_path_and_looks_for_none(scene: Path) -> None:
    out, options = scene.parent / "out.dgs", {"motion": "off", "balance": False}
    encode_sequence(scene, out, encoder_options(**options))
    assert "views" not in settings(scene)
    for views in (scene, str(scene / "cameras.json"), Views(tuple(some_cameras()))):
        held = encoder_options(views=views, **options)
        assert held.views is not None
        assert len(held.views.cameras) == 3
        encode_sequence(scene, out, held, force=True)
        assert "views=3/0.15" in settings(scene)
    with pytest.raises(InputError, match="views: found 3"):
        EncoderOptions(views=3)


def test_what_no_viewer_sees_is_left_out_and_told(tmp_path: Path) -> None:
    scene = write_frames(tmp_path / "scene", [room()] * 2)
    write_json(scene / "cameras.json", inria(viewers().cameras))
    quick = ("--qp", "27")
    done = encode(scene, *quick)
    assert done.returncode == 0, done.stderr
    info = settings(scene)
    told = re.search(r" unseen=(\d+) unseen_cost=([\d.]+)dB$", info)
    assert told is not None
    unseen, cost = int(told[1]), float(told[2])
    assert 60 <= unseen < 600
    said = (
        f"left out: {unseen} Gaussians of the first frame, which no viewer sees (costs about {cost:.2f} dB)"
    )
    assert f"{said}\n" in done.stdout
    assert " estimate=" in info
    assert info in dfcgs("info", tmp_path / "out.dgs").stdout
    found = json.loads(encode(scene, *quick, "--force", "--json").stdout)
    assert found["num_unseen"] == unseen
    assert found["unseen_cost_db"] == pytest.approx(cost, abs=0.01)
    assert [frame["num_gaussians"] for frame in found["frames"]] == [room().num_gaussians - unseen] * 2
    for options in (("--keep-unseen",), ("--views", "none")):
        done = encode(scene, *quick, "--force", *options)
        assert "left out" not in done.stdout
        assert probe(tmp_path / "out.dgs").frames[0].num_gaussians == room().num_gaussians
