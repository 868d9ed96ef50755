"""Small inputs that the command-line tests share."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from lab.small_clouds import drifting, real_cloud
from tests.helpers import dfcgs_process, write_frames

NUM_FRAMES = 5
GOF_SIZE = 2


@pytest.fixture(scope="session", autouse=True)
def _interrupts() -> None:
    """Commands under test can be interrupted, even if a shell's background job, which ignores that, tests."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def frames_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five frames of 300 Gaussians, numbered from 7."""
    folder = tmp_path_factory.mktemp("frames")
    write_frames(folder, drifting(real_cloud(300), NUM_FRAMES), first=7)
    return folder


@pytest.fixture(scope="session")
def stream(frames_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, encoded in GoFs of two."""
    path = tmp_path_factory.mktemp("stream") / "scene.dgs"
    done = dfcgs_process("encode", frames_dir, path, "--gof-size", str(GOF_SIZE), "--jobs", "1", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return path
