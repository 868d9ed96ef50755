"""`dfcgs export`: one page, with the file in it or beside it, and nothing from elsewhere."""

from __future__ import annotations

import gzip
import json
import re
from base64 import b64decode
from pathlib import Path

import pytest

from dfcgs_codec.core.module import MODULE
from dfcgs_codec.model.registry import context_model
from dfcgs_codec.player.page import page
from tests.helpers import dfcgs

#: bytes
MOST_WITHOUT_FILE = 400_000


def inside(text: str, name: str) -> str:
    """What the element of that id holds."""
    found = re.search(rf'<script type="[\w/]+" id="{name}">([^<]*)</script>', text)
    assert found is not None
    return found[1]


@pytest.fixture(scope="module")
def exported(stream: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    target = tmp_path_factory.mktemp("page") / "page.html"
    done = dfcgs("export", stream, target, "--up", "+y")
    assert done.returncode == 0, done.stderr
    assert str(target) in done.stdout
    return target.read_text()


def test_the_file_is_in_the_page(exported: str, stream: Path) -> None:
    config = json.loads(inside(exported, "config"))
    assert config == {"files": [{"name": "scene.dgs", "data": "file0"}], "up": "+y"}
    assert b64decode(inside(exported, "file0")) == stream.read_bytes()


def test_core_and_model_are_in_the_page(exported: str) -> None:
    assets = json.loads(inside(exported, "assets"))
    assert b64decode(assets["core"]) == MODULE.read_bytes()
    assert [model["id"] for model in assets["models"]] == ["main-1"]
    assert bytes.fromhex(assets["models"][0]["hash"]) == context_model("main-1").digest


def test_nothing_comes_from_elsewhere(exported: str) -> None:
    assert "default-src 'none'" in exported
    assert not re.search(r'(src|href)="?https?:|import\(', exported)


def test_a_link_leads_from_the_page_to_the_file(stream: Path, tmp_path: Path) -> None:
    target = tmp_path / "site" / "page.html"
    target.parent.mkdir()
    file = tmp_path / "my scene.dgs"
    file.write_bytes(stream.read_bytes())
    assert dfcgs("export", file, target, "--link", "--quiet").stdout == ""
    config = json.loads(inside(target.read_text(), "config"))
    assert config["files"] == [{"name": "my scene.dgs", "url": "../my%20scene.dgs"}]


def test_what_cannot_be_exported(stream: Path, tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    target.write_text("mine")
    done = dfcgs("export", stream, target)
    assert done.returncode == 1
    assert target.read_text() == "mine"
    half = tmp_path / "half.dgs"
    half.write_bytes(stream.read_bytes()[:300])
    assert dfcgs("export", half, tmp_path / "other.html").returncode == 3
    assert not (tmp_path / "other.html").exists()


def test_the_page_is_small() -> None:
    assert len(gzip.compress("".join(page([])).encode(), mtime=0)) < MOST_WITHOUT_FILE
