"""Which files of a folder are the frames: nothing is lost or added without a word."""

from __future__ import annotations

import os
import re
import shlex
import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import probe
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import MemorySource, open_folder
from lab.small_clouds import make_cloud
from tests.troubles.situations import ball, encode, moved, run, sequence, write

_TREE = "frame{:06d}/point_cloud/iteration_{}/point_cloud.ply"


def put(folder: Path, *names: str) -> None:
    """PLYs of one more Gaussian each, so that it can be seen which were taken in which order."""
    for index, name in enumerate(names):
        write(folder / name, ball(index + 1))


def taken(folder: Path, **options: object) -> tuple[list[str], list[str]]:
    """Names below the folder in the order of frames, and the notes."""
    source = open_folder(folder, **options)  # type: ignore[arg-type]
    return [path.relative_to(folder).as_posix() for path in source.paths], source.notes


def refusal(folder: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        open_folder(folder, **options)  # type: ignore[arg-type]
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


#: files, those that are frames (in order), words of the notes
FOLDERS = {
    "capitals": (["f_0.ply", "f_1.PLY", "f_2.Ply"], ["f_0.ply", "f_1.PLY", "f_2.Ply"], []),
    "AppleDouble": (["f_0.ply", "._f_0.ply"], ["f_0.ply"], ["1 hidden file left out", "._f_0.ply"]),
    "hidden": (["f_0.ply", ".f_1.ply", ".a.ply"], ["f_0.ply"], ["2 hidden files left out", ".a.ply"]),
    "text beside": (["f_0.ply", "cameras.json", "log.txt"], ["f_0.ply"], []),
    "splats beside": (["f_0.ply", "f_1.splat"], ["f_0.ply"], ["f_1.splat"]),
    "half a copy": (["f_0.ply", "f_1.ply.part"], ["f_0.ply"], ["f_1.ply.part"]),
    "packed": (["f_0.ply", "f_1.ply.gz"], ["f_0.ply"], ["f_1.ply.gz"]),
    "more below": (["f_0.ply", "old/f_1.ply"], ["f_0.ply"], ["1 PLY file left out", "old/f_1.ply"]),
    "input.ply beside": (["f_0.ply", "input.ply"], ["f_0.ply"], ["input.ply"]),
    "a still scene": (
        ["input.ply", "cameras.json", "point_cloud/iteration_7/p.ply", "point_cloud/iteration_30/p.ply"],
        ["point_cloud/iteration_30/p.ply"],
        ["input.ply", "latest iteration", "(30)", "iteration_7/p.ply", "--pattern"],
    ),
    "a tree": (
        [_TREE.format(t, 150) for t in (1, 2, 3)],
        [_TREE.format(t, 150) for t in (1, 2, 3)],
        ["3 files of its subfolders", "--pattern 'frame*/point_cloud/iteration_150/point_cloud.ply'"],
    ),
    "iterations": (
        [_TREE.format(t, i) for t in (1, 2, 10) for i in (1000, 999)],
        [_TREE.format(t, 1000) for t in (1, 2, 10)],
        ["latest iteration", "(1000)", "3 files of earlier ones are left out", "iteration_999"],
    ),
    "different iterations": (
        [_TREE.format(1, 150), _TREE.format(2, 150), _TREE.format(3, 90)],
        [_TREE.format(1, 150), _TREE.format(2, 150), _TREE.format(3, 90)],
        ["different iterations: 2 of 150", "frame000003/point_cloud/iteration_90/point_cloud.ply of 90"],
    ),
    "a frame that is not done": (
        [_TREE.format(1, 5), _TREE.format(2, 5), "frame000003/cfg_args"],
        [_TREE.format(1, 5), _TREE.format(2, 5)],
        ["frame000003"],
    ),
    "all but one that are not done": (
        [_TREE.format(1, 5), "frame000002/cfg_args"],
        [_TREE.format(1, 5)],
        ["1 file of its subfolders", "no PLY in it: frame000002"],
    ),
    "input.ply in every frame": (
        [name for t in (1, 2) for name in (f"f_{t}/input.ply", f"f_{t}/point_cloud/iteration_9/p.ply")],
        [f"f_{t}/point_cloud/iteration_9/p.ply" for t in (1, 2)],
        ["f_1/input.ply", "--pattern"],
    ),
    "added to one frame, later (3DGStream)": (
        [
            name
            for t in (1, 2, 10)
            for name in (
                _TREE.format(t, 150),
                f"frame{t:06d}/point_cloud/iteration_250/added/point_cloud.ply",
            )
        ],
        [_TREE.format(t, 150) for t in (1, 2, 10)],
        ["3 PLYs in folders called 'added'", "frames as taken lack; docs/inputs.md"],
    ),
    "added to one frame, in it (4DGC)": (
        [
            f"colmap_{t}/point_cloud/iteration_{name}.ply"
            for t in (1, 2, 10)
            for name in ("400/point_cloud", "500/point_cloud", "500/added/point_cloud", "500/added/exp_sh")
        ],
        [f"colmap_{t}/point_cloud/iteration_500/point_cloud.ply" for t in (1, 2, 10)],
        ["the latest iteration", "6 PLYs in folders called 'added'", "which it already holds"],
    ),
    "the frame and its iterations (QUEEN)": (
        [
            name
            for t, i in ((1, 10000), (2, 200), (10, 200))
            for name in (
                f"frames/{t:04d}/point_cloud.ply",
                f"frames/{t:04d}/point_cloud/iteration_{i}/point_cloud.ply",
            )
        ],
        [f"frames/{t:04d}/point_cloud.ply" for t in (1, 2, 10)],
        ["frames/0001/point_cloud/iteration_10000", "the frame itself lies beside"],
    ),
    "nothing but what is added": (
        ["f_1/added/p.ply", "f_2/added/p.ply"],
        ["f_1/added/p.ply", "f_2/added/p.ply"],
        ["--pattern 'f_*/added/p.ply'"],
    ),
    "numbered folders": (["9/ply/p.ply", "10/ply/p.ply"], ["9/ply/p.ply", "10/ply/p.ply"], ["'*/ply/p.ply'"]),
    "times below": (
        ["gaussians/time_00000.ply", "gaussians/time_00001.ply"],
        ["gaussians/time_00000.ply", "gaussians/time_00001.ply"],
        ["--pattern 'gaussians/time_*.ply'"],
    ),
    "numbered clouds of the latest iteration": (
        [f"it/iteration_{i}/point_cloud_{t}.ply" for i in (7, 8) for t in (0, 1)],
        ["it/iteration_8/point_cloud_0.ply", "it/iteration_8/point_cloud_1.ply"],
        ["(8)", "iteration_7/point_cloud_0.ply"],
    ),
}


@pytest.mark.parametrize("situation", FOLDERS)
def test_frames_of_a_folder(situation: str, tmp_path: Path) -> None:
    files, wanted, words = FOLDERS[situation]
    put(tmp_path, *files)
    found, notes = taken(tmp_path, allow_gaps=True)
    assert found == wanted
    assert bool(notes) == bool(words)
    for word in words:
        assert word in " ".join(notes)


@pytest.mark.parametrize(
    "situation", [name for name, (_, _, words) in FOLDERS.items() if "--pattern" in words[-1:]]
)
def test_the_pattern_that_is_said_takes_the_same(situation: str, tmp_path: Path) -> None:
    put(tmp_path, *FOLDERS[situation][0])
    found, notes = taken(tmp_path, allow_gaps=True)
    pattern = re.search(r"--pattern (.*)", notes[0])
    assert pattern is not None
    assert taken(tmp_path, pattern=shlex.split(pattern[1])[0], allow_gaps=True)[0] == found


def test_a_pattern_for_all_iterations_takes_the_latest(tmp_path: Path) -> None:
    put(tmp_path, *(_TREE.format(t, i) for t in (1, 2) for i in (150, 250)))
    found, notes = taken(tmp_path, pattern="*/point_cloud/iteration_*/point_cloud.ply")
    assert found == [_TREE.format(t, 250) for t in (1, 2)]
    assert "iteration_150" in notes[0]


def test_a_film_of_the_training_can_be_had(tmp_path: Path) -> None:
    put(tmp_path, "point_cloud/iteration_1/p.ply", "point_cloud/iteration_2/p.ply")
    found, _ = taken(tmp_path, pattern="point_cloud/iteration_*/p.ply")
    assert len(found) == 2


#: what is put into a folder of f_0.ply and f_1.ply, and words of the refusal
OBSTACLES: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "a link to nothing": (
        lambda folder: (folder / "f_2.ply").symlink_to("gone.ply"),
        ["f_2.ply is a link to gone.ply"],
    ),
    "a link to itself": (lambda folder: (folder / "f_2.ply").symlink_to("f_2.ply"), ["f_2.ply is a link"]),
    "a folder": (lambda folder: (folder / "f_2.ply").mkdir(), ["f_2.ply is a folder"]),
    "a folder in capitals": (lambda folder: (folder / "f_2.PLY").mkdir(), ["f_2.PLY is a folder"]),
    "a pipe": (lambda folder: os.mkfifo(folder / "f_2.ply"), ["f_2.ply is a named pipe"]),
    "a link to a device": (
        lambda folder: (folder / "f_2.ply").symlink_to("/dev/zero"),
        ["f_2.ply is a device"],
    ),
    "a socket": (lambda folder: _socket(folder / "f_2.ply"), ["f_2.ply is a socket"]),
    "an empty file": (lambda folder: (folder / "f_2.ply").touch(), ["f_2.ply"]),
    "one number in two cases": (lambda folder: put(folder, "f_1.PLY"), ["f_1.ply", "f_1.PLY"]),
    "a copy": (lambda folder: put(folder, "f_1 (1).ply"), ["f_1 (1).ply is not named like the other 2"]),
}


def _socket(path: Path) -> None:
    before = Path.cwd()
    # names of sockets are short
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(before)


@pytest.mark.parametrize("situation", OBSTACLES)
def test_what_only_looks_like_a_frame(situation: str, tmp_path: Path) -> None:
    act, words = OBSTACLES[situation]
    put(tmp_path, "f_0.ply", "f_1.ply")
    act(tmp_path)
    for options in ({}, {"pattern": "f_*.ply"}):
        message = refusal(tmp_path, **options)
        for word in words:
            assert word in message


@pytest.mark.parametrize("gone", [3, 2])
def test_a_frame_folder_that_is_a_link_to_nothing(gone: int, tmp_path: Path) -> None:
    put(tmp_path, *(_TREE.format(t, 150) for t in (1, 2, 3) if t != gone))
    (tmp_path / f"frame{gone:06d}").symlink_to("gone")
    assert f"frame{gone:06d} is a link to gone" in refusal(tmp_path)


#: files, words of the refusal
NOTHING = {
    "empty": ([], ["no file matches '*.ply'", "empty"]),
    "hidden only": (["._f_0.ply"], ["._f_0.ply"]),
    "splats": (["a.splat", "b.splat"], ["a.splat (and 1 more .splat)", "splat-transform a.splat a.ply"]),
    "spz": (["a.spz"], ["Niantic", "splat-transform a.spz a.ply"]),
    "sog": (["a.sog"], ["PlayCanvas", "splat-transform a.sog a.ply"]),
    "ksplat": (["a.ksplat"], ["splat-transform a.ksplat a.ply"]),
    "checkpoints": (["chkpnt7000.pth"], ["checkpoint", "PLY"]),
    "arrays": (["arrays.npz"], ["numpy arrays", "PLY"]),
    "a zip": (["frames.zip"], ["unzip frames.zip"]),
    "kinds in subfolders": (
        ["a/f_1.ply", "a/f_2.ply", "b/g.ply"],
        ["2 kinds", "--pattern 'a/f_*.ply' (2 files)", "--pattern b/g.ply (1 file)"],
    ),
    "two of each frame": (
        [
            "f_1/ply/p_69.ply",
            "f_1/ply/p_299.ply",
            "f_2/ply/p_69.ply",
            "f_2/ply/p_299.ply",
            "f_3/ply/p_299.ply",
        ],
        ["f_1/ply/p_", "--pattern", "'f_*/ply/p_299.ply'"],
    ),
    "scenes, no frames": (["a/p.ply", "b/p.ply"], ["2 kinds", "--pattern a/p.ply"]),
}


@pytest.mark.parametrize("situation", NOTHING)
def test_no_frames(situation: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfcgs_codec.ply.formats.find_spec", lambda _: None)
    files, words = NOTHING[situation]
    put(tmp_path, *files)
    message = refusal(tmp_path)
    for word in words:
        assert word in message
    for pattern in re.findall(r"--pattern ('[^']+'|\S+\.ply)", message):
        assert taken(tmp_path, pattern=pattern.strip("'"), allow_gaps=True)[0]


def test_another_pattern_is_told_where_plys_are(tmp_path: Path) -> None:
    put(tmp_path, _TREE.format(1, 150))
    assert "frame000001/point_cloud" in refusal(tmp_path, pattern="frame*/*.ply")


def test_a_link_back_is_no_end_of_folders(tmp_path: Path) -> None:
    put(tmp_path, "1/p.ply", "2/p.ply")
    (tmp_path / "1" / "up").symlink_to("..")
    assert taken(tmp_path)[0] == ["1/p.ply", "2/p.ply"]


def test_links_to_frames_are_frames(tmp_path: Path) -> None:
    put(tmp_path, "store/x.ply", "store/y.ply")
    (tmp_path / "film").mkdir()
    for index, name in enumerate("yx"):
        (tmp_path / "film" / f"f_{index}.ply").symlink_to(f"../store/{name}.ply")
    assert [h.num_gaussians for h in open_folder(tmp_path / "film").headers] == [2, 1]


def test_a_bad_last_header_is_the_first_thing_one_hears_of(tmp_path: Path) -> None:
    sequence(tmp_path / "frames", 12, n=2000)
    (tmp_path / "frames" / "frame_0011.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    started = time.process_time()
    done = encode(tmp_path / "frames", tmp_path / "out.dgs")
    assert done.code == 1
    assert "frame_0011.ply" in done.err
    assert time.process_time() - started < 1


def test_300_headers_are_quick(tmp_path: Path) -> None:
    sequence(tmp_path, 300, n=10)
    took = []
    for _ in range(3):
        # of this process alone: the machine may be busy
        started = time.process_time()
        open_folder(tmp_path)
        took.append(time.process_time() - started)
    assert min(took) < 0.5


# --- SH degrees that grow, and files that change -------------------------------------------------------


def test_sh_degrees_that_grow(tmp_path: Path) -> None:
    for t, degree in enumerate((0, 1, 3, 2)):
        write(tmp_path / "frames" / f"f_{t}.ply", moved(ball(20, degree), 0.02 * t))
    done = encode(tmp_path / "frames", tmp_path / "out.dgs", "--quality", "transparent")
    assert done.code == 0, done.err
    assert done.err.count("SH degree 3, but lower in 3 of 4 frames (first f_0.ply: 0)") == 1
    assert probe(tmp_path / "out.dgs").header.sh_degree == 3
    assert run("decode", tmp_path / "out.dgs", tmp_path / "back").code == 0
    clouds = [open_folder(tmp_path / "back").read(t)[0] for t in range(4)]
    for cloud, coefficients in zip(clouds, (0, 3, 15, 8), strict=True):
        assert np.abs(cloud.sh_rest[:, :, coefficients:]).max(initial=0) < 0.02
        assert coefficients == 0 or np.abs(cloud.sh_rest[:, :, :coefficients]).max() > 0.05


def test_sh_degrees_that_grow_in_memory() -> None:
    frames: list[GaussianCloud] = [make_cloud(5, 0), make_cloud(5, 2)]
    source = MemorySource(frames)
    assert "frame 0: 0" in source.notes[0]
    assert source.read(0)[0].sh_rest.shape == (5, 3, 8)
    assert source.read(1)[0] is frames[1]


@pytest.mark.parametrize("change", ["another N", "another degree", "gone", "cut"])
def test_files_that_change_meanwhile(change: str, tmp_path: Path) -> None:
    sequence(tmp_path, 3, n=20)
    source = open_folder(tmp_path)
    path = source.paths[1]
    if change == "another N":
        write(path, ball(21))
    elif change == "another degree":
        write(path, ball(20, 1))
    elif change == "gone":
        path.unlink()
    else:
        os.truncate(path, path.stat().st_size - 10)
    with pytest.raises(InputError) as caught:
        source.read(1)
    assert str(path) in str(caught.value)
    if change.startswith("another"):
        assert "changed meanwhile" in str(caught.value)
        assert "20 of SH degree 0" in str(caught.value)


def test_notes_are_said_before_the_work_and_once(tmp_path: Path) -> None:
    sequence(tmp_path / "frames", 2, "time_0.{}.ply")
    done = encode(tmp_path / "frames", tmp_path / "out.dgs", "--json")
    assert done.err.count("decimal numbers") == done.out.count("decimal numbers") == 1


def test_frames_are_not_reordered_by_their_options(tmp_path: Path) -> None:
    """The options that a message names lead to the same order."""
    for t, name in enumerate(("0.0", "0.05", "0.1", "0.15", "0.2")):
        write(tmp_path / "frames" / f"time_{name}.ply", ball(10 + t))
    for options in ((), ("--allow-gaps",), ("--order-by", "number"), ("--order-by", "time_{}")):
        target = tmp_path / f"{len(options)}{options[-1:]}.dgs"
        assert encode(tmp_path / "frames", target, *options).code == 0
        assert [frame.num_gaussians for frame in probe(target).frames] == [10, 11, 12, 13, 14]
