"""The tools that try other versions of the dependencies."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from types import ModuleType

import pytest

from tests.helpers import ROOT


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_floors_become_pins() -> None:
    oldest = tool("oldest_versions").oldest
    assert oldest(["numpy>=2.0", "constriction >=0.5, <0.6"]) == ["numpy==2.0", "constriction==0.5"]
    for dependency in ("click", "click<9", "click==8.1"):
        with pytest.raises(ValueError, match="click"):
            oldest([dependency])


def test_every_dependency_of_the_project_has_a_floor() -> None:
    command = [sys.executable, str(ROOT / "tools" / "oldest_versions.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    names = [line.split("==")[0] for line in done.stdout.splitlines()]
    assert names == ["numpy", "scipy", "constriction", "plyfile", "click", "wasmtime"]


def test_a_difference_fails_by_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    compare = tool("compare_versions")
    results = {"one": {"encode": "a", "info": "b"}, "other": {"encode": "c", "info": "b"}}
    monkeypatch.setattr(compare, "outcomes", lambda python, frames, work: results[python])
    assert compare.main("one", "other") == 1
    assert capsys.readouterr().out.splitlines() == [
        "encode: differs between one and other",
        "1 passed, 1 failed",
    ]
    assert compare.main("one", "one") == 0


def test_no_class_of_click_is_subscripted() -> None:
    """With click 8.1.0 to 8.3.1 that is a TypeError at import; see cli/values.py for the way round."""
    sources = {path.name: path.read_text() for path in (ROOT / "src" / "dfcgs_codec" / "cli").glob("*.py")}
    assert [name for name, text in sources.items() if re.search(r"click\.\w+\[", text)] == []
