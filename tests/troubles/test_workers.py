"""Several processes, wherever the encoder is called from, whatever happens to them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, InputError, encode_sequence
from dfcgs_codec.encoder import parallel
from dfcgs_codec.encoder.parallel import process as process_module
from dfcgs_codec.encoder.parallel.process import Worker
from dfcgs_codec.ply import PlyHeader
from lab.small_clouds import drifting, make_cloud
from tests.troubles.situations import run, sequence

OPTIONS = EncoderOptions(gof_size=1, jobs=2, qp=27)
FRAMES = drifting(make_cloud(50), 4)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of the sequence, coded by one process."""
    path = tmp_path_factory.mktemp("expected") / "a.dgs"
    encode_sequence(FRAMES, path, replace(OPTIONS, jobs=1))
    return path.read_bytes()


class OwnSource:
    """Frames of the caller's, and what reading them in another process does."""

    def __init__(self, fault: Any = None) -> None:
        self.fault, self.planned_by = fault, os.getpid()
        self.numbers = [10, 11, 12, 13]
        self.headers = [PlyHeader(50, 0)] * 4

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        if index and self.fault is not None and os.getpid() != self.planned_by:
            self.fault()
        return FRAMES[index], []


# --- where it is called from ------------------------------------------------------------------------------

SCRIPT = """print("the script begins")
from dfcgs_codec import EncoderOptions, encode_sequence
print(encode_sequence("frames", "out.dgs", EncoderOptions(gof_size=1, jobs=2, qp=27)).notes)
"""


@pytest.mark.parametrize("how", ["script", "stdin"])
def test_a_script_without_a_guard_runs_once(how: str, tmp_path: Path) -> None:
    sequence(tmp_path / "frames", n=50)
    script = tmp_path / "encode_it.py"
    script.write_text(SCRIPT)
    # what the worker imports is not taken from the folder that it is started in
    (tmp_path / "json.py").write_text("raise SystemExit('not me')") if how == "stdin" else None
    arguments = ["-P", "-"] if how == "stdin" else [str(script)]
    done = subprocess.run(
        [sys.executable, *arguments], input=SCRIPT, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("the script begins\n[]\n", "")
    assert (tmp_path / "out.dgs").exists()


def _encode_in_a_pool(target: Path) -> bytes:
    encode_sequence(FRAMES, target, OPTIONS)
    return target.read_bytes()


def test_in_a_process_of_a_pool(tmp_path: Path, expected: bytes) -> None:
    """Which is daemonic: `multiprocessing` lets it start no others."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(_encode_in_a_pool, [tmp_path / "a.dgs"]) == [expected]


def test_an_encode_in_another_thread_goes_on(tmp_path: Path, expected: bytes) -> None:
    """When one fails, it ends its own workers only."""
    results: list[object] = []

    def code(source: Any, name: str) -> None:
        try:
            results.append(encode_sequence(source, tmp_path / name, OPTIONS).num_bytes)
        except InputError as error:
            results.append(str(error))

    failing = threading.Thread(target=code, args=(OwnSource(refuse), "bad.dgs"))
    working = threading.Thread(target=code, args=(FRAMES, "a.dgs"))
    for thread in (working, failing):
        thread.start()
    for thread in (working, failing):
        thread.join()
    assert sorted(results, key=str) == [len(expected), "this frame is refused"]
    assert (tmp_path / "a.dgs").read_bytes() == expected


# --- what cannot go to other processes -------------------------------------------------------------------


def test_frames_of_a_class_that_others_cannot_load(tmp_path: Path, expected: bytes) -> None:
    source = type("OfAScript", (OwnSource,), {"__module__": "__main__"})()
    sys.modules["__main__"].OfAScript = type(source)  # type: ignore[attr-defined]
    try:
        report = encode_sequence(source, tmp_path / "a.dgs", OPTIONS)
    finally:
        del sys.modules["__main__"].OfAScript  # type: ignore[attr-defined]
    (note,) = report.notes
    assert "coded in one process" in note
    assert "module that they can import" in note


NOWHERE: dict[str, tuple[str, Any, str]] = {
    "frozen": ("interpreter", lambda: None, "no Python interpreter"),
    "no processes": (
        "Worker",
        OSError(11, "Resource temporarily unavailable"),
        "no process could be started",
    ),
    "a broken start": ("interpreter", lambda: "false", "end as they start"),
}


@pytest.mark.parametrize("what", NOWHERE)
def test_where_no_process_can_be_started(
    what: str, tmp_path: Path, expected: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, instead, reason = NOWHERE[what]

    def fail(python: str) -> None:
        raise instead

    monkeypatch.setattr(parallel, name, fail if isinstance(instead, OSError) else instead)
    report = encode_sequence(FRAMES, tmp_path / "a.dgs", OPTIONS)
    assert [reason in note for note in report.notes] == [True]
    assert (tmp_path / "a.dgs").read_bytes() == expected


def test_frames_that_cannot_be_pickled(tmp_path: Path) -> None:
    report = encode_sequence(OwnSource(lambda: None), tmp_path / "a.dgs", OPTIONS)
    assert ["cannot be sent to other processes" in note for note in report.notes] == [True]


def test_fewer_processes_than_asked_for_will_do(
    tmp_path: Path, expected: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Worker] = []

    def one(python: str) -> Worker:
        if made:
            raise OSError(11, "Resource temporarily unavailable")
        made.append(Worker(python))
        return made[0]

    monkeypatch.setattr(parallel, "Worker", one)
    assert encode_sequence(FRAMES, tmp_path / "a.dgs", OPTIONS).notes == []
    assert (tmp_path / "a.dgs").read_bytes() == expected


# --- what happens in them --------------------------------------------------------------------------------


def refuse() -> None:
    raise InputError("this frame is refused")


class Unpicklable(Exception):
    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")


def raise_unpicklable() -> None:
    raise Unpicklable(1, 2)


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def chatter() -> None:
    print("something on standard output")
    os.write(1, b"and more, past Python")
    assert sys.stdin.read() == ""


ENDS: dict[str, tuple[Any, type[BaseException], str]] = {
    "an error of ours": (refuse, InputError, "^this frame is refused$"),
    "an error that cannot travel": (raise_unpicklable, RuntimeError, "Unpicklable: 1 and 2"),
    "killed": (
        die,
        InputError,
        r"frames 1[1-3] to 1[1-3] \(process \d+\) was ended by SIGKILL.*memory.*fewer",
    ),
}


@pytest.mark.parametrize("what", ENDS)
def test_what_ends_a_worker_ends_the_run(what: str, tmp_path: Path) -> None:
    fault, error, words = ENDS[what]
    with pytest.raises(error, match=words):
        encode_sequence(OwnSource(fault), tmp_path / "a.dgs", OPTIONS)
    assert list(tmp_path.iterdir()) == []


def test_what_a_source_prints_is_not_taken_for_a_frame(
    tmp_path: Path, expected: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    encode_sequence(OwnSource(chatter), tmp_path / "a.dgs", OPTIONS)
    assert capfd.readouterr().out == ""


def test_killed_while_it_starts(frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(python: str) -> Worker:
        worker = Worker(python)
        worker.kill()
        return worker

    monkeypatch.setattr(parallel, "Worker", killed)
    done = run("encode", frames, tmp_path / "a.dgs", "--gof-size", "1", "--jobs", "2")
    assert done.code == 1
    assert len(done.err.splitlines()) == 1
    assert "the worker process of frames 0 to 0" in done.err
    assert "ended by SIGKILL" in done.err


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    return sequence(tmp_path / "frames", n=50)


def test_no_threads_is_one_line(frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: Any) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", fail)
    for jobs in ("1", "2"):
        done = run("encode", frames, tmp_path / "a.dgs", "--gof-size", "1", "--jobs", jobs)
        assert (done.code, done.out) == (1, "")
        assert len(done.err.splitlines()) == 1
        assert "start no more threads" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_workers_get_one_thread_each_unless_told_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    seen: dict[str, str] = {}

    def note(command: list[str], env: dict[str, str], **named: Any) -> None:
        seen.update(env)

    monkeypatch.setattr(process_module.subprocess, "Popen", note)
    Worker(sys.executable)
    assert (seen["OMP_NUM_THREADS"], seen["OPENBLAS_NUM_THREADS"]) == ("3", "1")
