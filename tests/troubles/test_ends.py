"""How a run ends that is not let finish: one line, nothing left, and soon."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec.cli import ends
from dfcgs_codec.cli.ends import Ended, ended_by_signals
from dfcgs_codec.files import replace_when_whole
from tests.troubles.situations import encode, run, sequence

SIGNALS = [name for name in ("SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)]


@pytest.fixture(autouse=True)
def _heard() -> Iterator[None]:
    """Commands under test hear all signals, even if a shell's background job, or nohup, runs the tests."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)}
    for number, handler in before.items():
        if handler == signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames that take long enough to be interrupted."""
    return sequence(tmp_path_factory.mktemp("input") / "frames", count=20, n=3000)


def started(*arguments: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "dfcgs_codec", *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)


def is_gone(session: int) -> bool:
    """Whether no process of the session runs any more."""
    found = subprocess.run(
        ["ps", "-o", "stat=", "-s", str(session)], capture_output=True, text=True, check=False
    )
    return all(line.startswith("Z") for line in found.stdout.split())


@pytest.mark.parametrize(
    ("name", "jobs", "group"),
    [("SIGTERM", 1, False), ("SIGHUP", 2, False), ("SIGQUIT", 1, True), ("SIGTERM", 2, True)],
)
def test_a_signal_leaves_nothing(name: str, jobs: int, group: bool, frames: Path, tmp_path: Path) -> None:
    process = started(
        "encode", frames, tmp_path / "out.dgs", "--gof-size", "2", "--qp", "27", "--jobs", str(jobs)
    )
    wait_for(lambda: any(tmp_path.iterdir()))
    time.sleep(0.5 * (jobs - 1))
    (os.killpg if group else os.kill)(process.pid, getattr(signal, name))
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    # click ends the terminal's line first
    assert err.strip() == f"dfcgs: interrupted ({name}); nothing was written"
    assert list(tmp_path.iterdir()) == []
    wait_for(lambda: is_gone(process.pid))
    assert is_gone(process.pid)


def test_killed_at_once_it_leaves_no_process(frames: Path, tmp_path: Path) -> None:
    process = started("encode", frames, tmp_path / "out.dgs", "--gof-size", "2", "--qp", "27", "--jobs", "2")
    wait_for(lambda: any(tmp_path.iterdir()))
    time.sleep(0.5)
    process.kill()
    process.communicate(timeout=60)
    wait_for(lambda: is_gone(process.pid))
    assert is_gone(process.pid)


def test_what_is_ignored_stays_so(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """As with nohup."""
    frames = sequence(tmp_path_factory.mktemp("short"), count=4)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        process = started("encode", frames, tmp_path / "out.dgs", "--quiet", "--qp", "27", "--jobs", "1")
    finally:
        signal.signal(signal.SIGHUP, before)
    wait_for(lambda: any(tmp_path.iterdir()))
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=60) == (None, "")
    assert process.returncode == 0


# --- in this process --------------------------------------------------------------------------------------


def kill_me(number: int) -> None:
    os.kill(os.getpid(), number)
    time.sleep(0.05)


@pytest.mark.parametrize("name", SIGNALS)
def test_handlers_are_put_back(name: str) -> None:
    number = getattr(signal, name)
    before = signal.getsignal(number)
    with pytest.raises(Ended, match=name), ended_by_signals():
        kill_me(number)
    assert signal.getsignal(number) == before


def test_a_second_signal_does_not_disturb_the_clearing_up() -> None:
    cleared = False
    with ended_by_signals():
        try:
            kill_me(signal.SIGTERM)
        except KeyboardInterrupt:
            kill_me(signal.SIGTERM)
            kill_me(signal.SIGINT)
            cleared = True
    assert cleared


def test_a_file_that_gets_its_name_is_not_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = os.link
    monkeypatch.setattr(os, "link", lambda a, b: (kill_me(signal.SIGTERM), link(a, b)))
    with ended_by_signals(), replace_when_whole(tmp_path / "a", force=False) as file:
        file.write(b"data")
    assert (tmp_path / "a").read_bytes() == b"data"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="ends a process of its own")
def test_a_process_that_hears_nothing_leaves_all_the_same(tmp_path: Path) -> None:
    """The main thread does not come to unwind: something long in compiled code, or an error that got lost."""
    child = os.fork()
    if not child:
        try:
            ends._SECONDS_TO_UNWIND = 0.1
            os.dup2(os.open(tmp_path / "err", os.O_WRONLY | os.O_CREAT), 2)
            with ended_by_signals(), replace_when_whole(tmp_path / "a", force=False):
                try:
                    kill_me(signal.SIGTERM)
                except KeyboardInterrupt:
                    time.sleep(60)
        finally:
            os._exit(77)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["err"]
    assert (tmp_path / "err").read_text() == "\ndfcgs: interrupted (SIGTERM); nothing was written\n"


# --- errors of the system -----------------------------------------------------------------------------------

FAILURES: dict[str, tuple[BaseException, str]] = {
    "without a file": (OSError(errno.EIO, "Input/output error"), "dfcgs: Input/output error\n"),
    "without anything": (OSError(), "dfcgs: OSError\n"),
    "with a file": (OSError(errno.EIO, "Input/output error", "x.ply"), "dfcgs: x.ply: Input/output error\n"),
    "no memory": (MemoryError(), "dfcgs: out of memory; encode with fewer --jobs, or where more is free\n"),
    "no threads": (
        RuntimeError("can't start new thread"),
        "dfcgs: the system lets this user start no more threads (ulimit -u); encode with --jobs 1, "
        "or end other programs\n",
    ),
}


@pytest.mark.parametrize("what", FAILURES)
def test_an_error_of_the_system_is_one_line(
    what: str, frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    error, line = FAILURES[what]

    def fail(*arguments: Any, **named: Any) -> None:
        raise error

    monkeypatch.setattr("dfcgs_codec.encoder.frame.encoder.plan_sequence", fail)
    done = encode(frames, tmp_path / "a.dgs")
    assert (done.code, done.out, done.err) == (1, "", line)
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_program_stays_one(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: Any, **named: Any) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("dfcgs_codec.encoder.frame.encoder.plan_sequence", fail)
    with pytest.raises(RuntimeError, match="a bug"):
        run("encode", frames, tmp_path / "a.dgs")
