"""The command line keeps numpy's BLAS to one thread: more would only spin, and slow the encoder down."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

#: the command fails for want of its folder, but only after numpy was loaded
SCRIPT = """
import os, sys
from dfcgs_codec.cli import main
assert "numpy" not in sys.modules
try:
    main()
except SystemExit:
    pass
assert "numpy" in sys.modules
print(os.environ["OPENBLAS_NUM_THREADS"], len(os.listdir("/proc/self/task")))
"""


def threads(**variables: str) -> list[str]:
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", SCRIPT, "encode", "/nowhere", "/nowhere.dgs"]
    done = subprocess.run(command, env=environment | variables, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts the threads of a Linux process")
def test_encode_runs_on_one_thread():
    assert threads() == ["1", "1"]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts the threads of a Linux process")
def test_the_user_may_ask_for_more():
    assert threads(OPENBLAS_NUM_THREADS="2")[0] == "2"
