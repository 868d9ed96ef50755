"""The examples of the README's 'From Python' run as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.helpers import ROOT
from tests.troubles.situations import sequence

EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


@pytest.fixture(autouse=True)
def messages_as_written() -> None:
    """The examples print what a Python user reads."""


def test_examples_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence(tmp_path / "frames", n=30)
    monkeypatch.chdir(tmp_path)
    assert len(EXAMPLES) == 2
    for example in EXAMPLES:
        exec(compile(example, "README.md", "exec"), {"__name__": "__main__"})
    assert "out.dgs exists; force=True replaces it" in capsys.readouterr().out
