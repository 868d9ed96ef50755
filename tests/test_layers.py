"""Imports go down the floors, and a decoder loads no more than it needs."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.helpers import ROOT, run_python

_LOADED = """
import sys
import {module}
print("\\n".join(sys.modules))
"""


def loaded_by(module: str) -> set[str]:
    done = run_python("-c", _LOADED.format(module=module))
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "module", [f"dfcgs_codec.codec.frame.{name}" for name in ("decoder", "salvage", "probe")]
)
def test_a_decoder_loads_neither_the_encoder_nor_torch(module: str) -> None:
    loaded = loaded_by(module)
    assert module in loaded
    assert not [name for name in loaded if name.startswith("dfcgs_codec.encoder")]
    assert not loaded & {"torch", "plyfile", "scipy", "click", "numba"}


def test_the_package_itself_loads_no_arrays() -> None:
    assert "numpy" not in loaded_by("dfcgs_codec")


def test_the_encoder_does_not_load_torch() -> None:
    assert not loaded_by("dfcgs_codec.api") & {"torch", "numba"}


def test_nothing_but_tests_imports_tests() -> None:
    own = re.compile(r"^\s*(from|import) tests\b", re.MULTILINE)
    folders = [ROOT / name for name in ("src", "lab", "training", "evaluation", "tools")]
    others = [path for folder in folders for path in folder.rglob("*.py")]
    assert not [path for path in others if own.search(path.read_text())]


def test_imports_go_down_the_floors() -> None:
    script = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", script, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "5 kept, 0 broken" in done.stdout
