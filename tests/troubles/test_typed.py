"""What people type for the frames: it works, or one line says what to type instead."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dfcgs_codec import probe
from tests.troubles.situations import Outcome, ball, encode, run, sequence, write


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a folder of three frames, and what else lies about."""
    monkeypatch.chdir(tmp_path)
    sequence(tmp_path / "film", 3, n=10)
    with zipfile.ZipFile(tmp_path / "film.zip", "w") as archive:
        archive.write(tmp_path / "film" / "frame_0000.ply", "frame_0000.ply")
    (tmp_path / "list.txt").write_text("film/frame_0000.ply\n")
    (tmp_path / "old.dgs").write_bytes(b"\x89DGS")
    (tmp_path / "splat.splat").write_bytes(bytes(32))
    (tmp_path / "notes.md").write_text("notes")
    os.mkfifo(tmp_path / "pipe")
    write(tmp_path / "cameras" / "a.ply", ball(3))
    return tmp_path


ONE, TWO, THREE = (f"film/frame_000{t}.ply" for t in range(3))
#: arguments, number of frames, words on stderr
WORKS = {
    "the folder": (["film"], 3, []),
    "with a slash": (["film/"], 3, []),
    "all files": ([ONE, TWO, THREE], 3, ["3 files named as frames"]),
    "in another order": ([THREE, ONE, TWO], 3, []),
    "some files": ([ONE, TWO], 2, ["1 other PLY file left out", "frame_0002.ply"]),
    "a glob in quotes": (["film/frame_*.ply"], 3, []),
    "a glob of a folder": (["fi*m"], 3, []),
    "one file": ([ONE], 1, ["frame_0000.ply is the only frame", "2 other PLY files"]),
}


@pytest.mark.parametrize("situation", WORKS)
def test_it_works(situation: str, home: Path) -> None:
    arguments, count, words = WORKS[situation]
    done = run("encode", *arguments, "out.dgs", "--jobs", "1", "--qp", "27")
    assert done.code == 0, done.err
    assert [frame.frame_number for frame in probe(home / "out.dgs").frames] == list(range(count))
    for word in words:
        assert word in done.err


#: arguments, exit code, words on stderr
REFUSED = {
    "no such folder": (["nowhere", "out.dgs"], 1, ["nowhere does not exist"]),
    "a glob of nothing": (["film/g_*.ply", "out.dgs"], 1, ["film/g_*.ply: no file matches"]),
    "a zip": (["film.zip", "out.dgs"], 1, ["film.zip", "unzip film.zip"]),
    "a pipe": (["-", "out.dgs"], 1, ["pipe", "name a folder"]),
    "a named pipe": (["pipe", "out.dgs"], 1, ["pipe is a pipe"]),
    "a list": (["list.txt", "out.dgs"], 1, ["list.txt is a list", "$(cat list.txt)"]),
    "a file": (["notes.md", "out.dgs"], 1, ["notes.md is a file, not a folder"]),
    "a splat": (["splat.splat", "out.dgs"], 1, ["splat-transform splat.splat splat.ply"]),
    "an encoded file": (["old.dgs", "new.dgs"], 1, ["encoded already", "dfcgs decode old.dgs"]),
    "swapped": (["old.dgs", "film"], 1, ["dfcgs encode film old.dgs"]),
    "swapped, not there": (["new.dgs", "film"], 1, ["dfcgs encode film new.dgs"]),
    "swapped, no ending": (["new", "film"], 1, ["dfcgs encode film new"]),
    "no output": ([ONE, TWO], 1, ["frame_0001.ply: the last argument is the file to write"]),
    "no output, forced": ([ONE, TWO, "--force"], 1, ["the last argument is the file to write"]),
    "one argument": (["film"], 2, ["dfcgs encode film out.dgs"]),
    "everything of a folder": ([ONE, "notes.md", "out.dgs"], 1, ["notes.md is no PLY", "name the folder"]),
    "two folders": (["film", "cameras", "out.dgs"], 1, ["2 folders", "dfcgs encode . out.dgs"]),
    "folder and file": (["film", ONE, "out.dgs"], 1, ["film is a folder", "frame_0000.ply a file"]),
    "a file twice": ([ONE, ONE, "out.dgs"], 1, ["frame_0000.ply named twice"]),
    "a file and a pattern": ([ONE, "out.dgs", "--pattern", "f*.ply"], 1, ["--pattern", "is a file"]),
    "an empty name": (["", "out.dgs"], 1, ["is empty"]),
    "a gap": ([ONE, THREE, "out.dgs"], 1, ["frames 1 to 1 are missing"]),
}


@pytest.mark.parametrize("situation", REFUSED)
def test_it_is_said_what_to_type(situation: str, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfcgs_codec.ply.formats.find_spec", lambda _: None)
    arguments, code, words = REFUSED[situation]
    before = _contents(home)
    done = run("encode", *arguments)
    assert (done.code, done.out) == (code, ""), done.err
    assert code == 2 or len(done.err.splitlines()) == 1
    for word in words:
        assert word in done.err
    assert _contents(home) == before


def _contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _one_in_each(home: Path) -> Outcome:
    for t in range(2):
        write(home / "scene" / f"f_{t}" / "p.ply", ball(5))
    return run("encode", "scene/f_0", "scene/f_1", "out.dgs")


#: ways to a refusal whose advice is then followed
ADVICE: dict[str, tuple[Callable[[Path], Outcome], list[str]]] = {
    "a folder for each frame": (_one_in_each, ["scene", "out.dgs"]),
    "swapped": (lambda _: run("encode", "out.dgs", "film"), ["film", "out.dgs"]),
}


@pytest.mark.parametrize("situation", ADVICE)
def test_the_advice_works(situation: str, home: Path) -> None:
    act, arguments = ADVICE[situation]
    refused = act(home)
    assert refused.code == 1
    assert "dfcgs encode " + " ".join(arguments) in refused.err
    assert run("encode", *arguments, "--jobs", "1", "--qp", "27").code == 0


def test_order_by_reaches_the_frames(home: Path) -> None:
    for t in range(3):
        write(home / "two" / f"f_{t}_cam_{9 - t}.ply", ball(10 + t))
    refused = encode(home / "two", home / "out.dgs")
    assert refused.code == 1
    assert "--order-by 'f_{}' or --order-by '_cam_{}'" in refused.err
    assert encode(home / "two", home / "out.dgs", "--order-by", "_cam_{}").code == 0
    assert [frame.num_gaussians for frame in probe(home / "out.dgs").frames] == [12, 11, 10]
    assert [frame.frame_number for frame in probe(home / "out.dgs").frames] == [7, 8, 9]
