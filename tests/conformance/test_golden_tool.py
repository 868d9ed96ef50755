"""`tools/make_golden.py` adds what is missing and leaves released streams alone."""

from __future__ import annotations

import importlib.util
import json
import shutil
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import pytest

from dfcgs_codec import decode_sequence, probe
from tests.helpers import ROOT

FOLDER = Path(__file__).parent


@pytest.fixture
def tool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The tool, at work on a copy."""
    spec = importlib.util.spec_from_file_location("make_golden", ROOT / "tools" / "make_golden.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shutil.copytree(FOLDER, tmp_path / "conformance")
    monkeypatch.setattr(module, "FOLDER", tmp_path / "conformance")
    return module


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.glob("*/*.dgs"))}


def forget(folder: Path, kind: str, name: str) -> None:
    """As if the stream had never been made."""
    (folder / kind / f"{name}.dgs").unlink()
    expected = json.loads((folder / "expected.json").read_text())
    del expected[kind][name]
    (folder / "expected.json").write_text(json.dumps(expected))


def test_nothing_is_written_where_nothing_is_missing(tool: ModuleType) -> None:
    before = contents(tool.FOLDER), json.loads((tool.FOLDER / "expected.json").read_text())
    assert tool.make(new_version=False) == 0
    assert (contents(tool.FOLDER), json.loads((tool.FOLDER / "expected.json").read_text())) == before


def test_only_what_is_missing_is_written(tool: ModuleType) -> None:
    before = contents(tool.FOLDER)
    expected = json.loads((tool.FOLDER / "expected.json").read_text())
    for kind, name in (("faulty", "spare_words"), ("valid", "numbers_with_gaps")):
        forget(tool.FOLDER, kind, name)
    # a released stream that this encoder would make otherwise
    (tool.FOLDER / "valid" / "odd_rate.dgs").write_bytes(b"frozen")
    assert tool.make(new_version=False) == 2
    assert contents(tool.FOLDER) == before | {"valid/odd_rate.dgs": b"frozen"}
    assert json.loads((tool.FOLDER / "expected.json").read_text()) == expected


def test_another_bitstream_version_needs_a_word(tool: ModuleType) -> None:
    expected = json.loads((tool.FOLDER / "expected.json").read_text())
    (tool.FOLDER / "expected.json").write_text(json.dumps(expected | {"bitstream_version": 0}))
    with pytest.raises(SystemExit, match="--new-version"):
        tool.make(new_version=False)


def test_every_stream_says_what_it_needs(tool: ModuleType) -> None:
    expected = json.loads((FOLDER / "expected.json").read_text())
    for kind in ("valid", "uncommon"):
        for name, found in expected[kind].items():
            assert found["annexes"] == tool._annexes(FOLDER / kind / f"{name}.dgs"), name


def test_streams_are_small() -> None:
    sizes = {name: len(data) for name, data in contents(FOLDER).items()}
    assert max(sizes.values()) < 20_000
    assert sum(sizes.values()) < 600_000


def test_what_the_headers_say() -> None:
    gaps, rate = (FOLDER / "valid" / f"{name}.dgs" for name in ("numbers_with_gaps", "odd_rate"))
    assert [frame.number for frame in decode_sequence(gaps)] == [3, 4, 9, 20]
    assert Fraction(*probe(rate).header.frame_rate) == Fraction(30000, 1001)
