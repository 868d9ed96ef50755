"""What users and systems do that nobody planned for: one line of explanation, nothing lost, nothing left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dfcgs_codec.ply import peek_header
from lab.chunks import join_chunks, split_chunks
from lab.small_clouds import drifting, make_cloud, real_cloud
from tests.cli.test_encode import QUICK, fails
from tests.helpers import dfcgs, dfcgs_process, ply_table, write_frames, write_table


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def in_folder(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dfcgs_codec", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


# --- interrupts ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames that take long enough to be interrupted."""
    return write_frames(tmp_path_factory.mktemp("long") / "frames", drifting(real_cloud(8000), 12))


@pytest.fixture(scope="module")
def long_stream(long_sequence: Path) -> Path:
    path = long_sequence.parent / "long.dgs"
    assert (
        dfcgs(
            "encode", long_sequence, path, "--gof-size", "4", "--qp", "30", "--jobs", "1", "--quiet"
        ).returncode
        == 0
    )
    return path


def interrupt(arguments: list[str], begun: Callable[[], bool], *, group: bool) -> tuple[int, str, str]:
    """Press Ctrl-C once `begun`; a terminal interrupts the whole process group."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dfcgs_codec", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not begun() and time.monotonic() < deadline:
        time.sleep(0.01)
    (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.mark.parametrize(("jobs", "delay"), [("1", 0.0), ("2", 1.5)])
def test_ctrl_c_while_encoding(long_sequence: Path, tmp_path: Path, jobs: str, delay: float) -> None:
    def begun() -> bool:
        time.sleep(delay if any(tmp_path.iterdir()) else 0)
        return any(tmp_path.iterdir())

    arguments = ["encode", str(long_sequence), str(tmp_path / "out.dgs"), "--gof-size", "2"]
    arguments += ["--qp", "27", "--jobs", jobs]
    code, out, err = interrupt(arguments, begun, group=True)
    assert (code, out) == (1, ""), err
    # click ends the terminal's line first
    assert err.strip() == "dfcgs: interrupted; nothing was written"
    assert names(tmp_path) == []


def test_ctrl_c_while_decoding(long_stream: Path, tmp_path: Path) -> None:
    arguments = ["decode", str(long_stream), str(tmp_path / "out")]
    code, out, err = interrupt(arguments, lambda: any(tmp_path.glob(".out*/*.ply")), group=True)
    assert (code, out) == (1, ""), err
    # click ends the terminal's line first
    assert err.strip() == "dfcgs: interrupted; nothing was written"
    assert names(tmp_path) == []


@pytest.mark.parametrize("option", ["--json", "--chunks"])
def test_a_closed_pipe_is_quiet(stream: Path, option: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "dfcgs_codec", "info", str(stream), option],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    message = process.stderr.read()
    process.stderr.close()
    assert process.wait(60) in (0, 1)
    assert "Traceback" not in message


# --- targets ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", [".", "..", "inner/.."])
def test_the_folder_of_the_file_is_not_deleted(stream: Path, tmp_path: Path, target: str) -> None:
    home = tmp_path / "home"
    (home / "inner").mkdir(parents=True)
    (home / "scene.dgs").write_bytes(stream.read_bytes())
    (home / "inner" / "scene.dgs").write_bytes(stream.read_bytes())
    start = home / "inner" if target == ".." else home
    in_folder(start, "decode", "scene.dgs", target, "--force")
    assert (start / "scene.dgs").read_bytes() == stream.read_bytes()


def test_an_output_folder_that_holds_the_file_is_refused(stream: Path, tmp_path: Path) -> None:
    (tmp_path / "work").mkdir()
    own = tmp_path / "work" / "scene.dgs"
    own.write_bytes(stream.read_bytes())
    done = dfcgs("decode", own, tmp_path / "work", "--force")
    assert own.exists(), done.stdout
    fails(done, 1, "work")


def test_a_target_that_is_a_folder(frames_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").touch()
    for force in ([], ["--force"]):
        fails(dfcgs("encode", frames_dir, tmp_path / "out", *force), 1, "out", "folder")
    assert names(tmp_path / "out") == ["mine.txt"]


def test_a_target_in_no_folder(frames_dir: Path, stream: Path, tmp_path: Path) -> None:
    fails(dfcgs("encode", frames_dir, tmp_path / "no" / "out.dgs"), 1, "no such folder")
    fails(dfcgs("decode", stream, tmp_path / "no" / "out"), 1, "no such folder")
    assert names(tmp_path) == []


def test_a_file_where_the_folder_should_be(stream: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    for force in ([], ["--force"]):
        fails(dfcgs("decode", stream, tmp_path / "out", *force), 1, "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_an_unwritable_folder(frames_dir: Path, tmp_path: Path) -> None:
    """The file system itself says no, even to root."""
    fails(dfcgs("encode", frames_dir, Path("/proc") / "out.dgs"), 1, "/proc")
    assert names(tmp_path) == []


# --- input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [b"", b"not a ply at all", b"\x89PNG\r\n\x1a\n" + bytes(100)])
def test_a_frame_that_is_no_ply(tmp_path: Path, content: bytes) -> None:
    write_frames(tmp_path, drifting(make_cloud(5), 2))
    (tmp_path / "frame_0002.ply").write_bytes(content)
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, "frame_0002.ply", "PLY")
    assert not (tmp_path / "a.dgs").exists()


@pytest.mark.parametrize("where", [0, 1])
def test_a_frame_without_gaussians(tmp_path: Path, where: int) -> None:
    frames = write_frames(tmp_path / "in", drifting(make_cloud(5), 2))
    write_table(frames / f"frame_{where:04d}.ply", ply_table(make_cloud(1))[:0])
    assert dfcgs("encode", frames, tmp_path / "a.dgs", *QUICK).returncode == 0
    assert dfcgs("decode", tmp_path / "a.dgs", tmp_path / "out").returncode == 0
    counts = [peek_header(path).num_gaussians for path in sorted((tmp_path / "out").iterdir())]
    assert counts == [0 if index == where else 5 for index in range(2)]


def test_an_error_in_another_process_is_one_line(tmp_path: Path) -> None:
    write_frames(tmp_path / "frames", drifting(make_cloud(50), 6))
    bad = tmp_path / "frames" / "frame_0005.ply"
    bad.write_bytes(bad.read_bytes()[:-10])
    done = dfcgs("encode", tmp_path / "frames", tmp_path / "a.dgs", "--gof-size", "2", "--jobs", "2", *QUICK)
    fails(done, 1, "frame_0005.ply", "truncated")
    assert names(tmp_path) == ["frames"]


def test_no_frame_at_all(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    fails(dfcgs("encode", tmp_path / "frames", tmp_path / "a.dgs"), 1, "no file matches '*.ply'")


@pytest.mark.parametrize("arguments", [["--pattern", ""], ["--pattern", "/*.ply"], ["--fps", "1e30"]])
def test_arguments_that_cannot_be(frames_dir: Path, tmp_path: Path, arguments: list[str]) -> None:
    done = dfcgs("encode", frames_dir, tmp_path / "a.dgs", *arguments)
    assert done.returncode in (1, 2)
    fails(done, done.returncode)
    assert names(tmp_path) == []


def test_a_frame_number_beyond_64_bits(tmp_path: Path) -> None:
    write_table(tmp_path / f"frame_{10**25}.ply", ply_table(make_cloud(3)))
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, "frame")


def test_a_bound_that_cannot_be_kept(frames_dir: Path, tmp_path: Path) -> None:
    for bound in ("position=1e-12", "rotation=1e-9"):
        fails(dfcgs("encode", frames_dir, tmp_path / "a.dgs", "--bound", bound), 1, "--bound")
    assert names(tmp_path) == []


def test_a_file_without_frames(stream: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.dgs"
    empty.write_bytes(join_chunks(split_chunks(stream.read_bytes())[:2]))
    fails(dfcgs("decode", empty, tmp_path / "out"), 3, "[corrupt]")
    done = dfcgs("info", empty)
    assert "Traceback" not in done.stderr
    assert names(tmp_path) == ["empty.dgs"]


def test_quiet_is_quiet(frames_dir: Path, tmp_path: Path) -> None:
    done = dfcgs_process("encode", frames_dir, tmp_path / "a.dgs", "--quiet", "--verify")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    done = dfcgs_process("decode", tmp_path / "a.dgs", tmp_path / "out", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
