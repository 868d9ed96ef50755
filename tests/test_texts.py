"""README.md and docs/: short lines, a short front page, links and names of files that lead somewhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LONGEST_LINE, LONGEST_FRONT_PAGE, LONGEST_CONTRIBUTING = 140, 130, 120
#: files and folders of the repository in backticks, from its top or from that of the package
_FOLDERS = "src|lab|training|evaluation|assets|tests|tools|bitstream|codec|encoder|model|transform"
_FILE = re.compile(rf"`((?:{_FOLDERS})/[\w/.]*)")
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def prose(page: Path) -> Iterator[tuple[int, str]]:
    """Lines by number, without tables and code."""
    is_code = False
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if line.startswith("```"):
            is_code = not is_code
        elif not is_code and not line.startswith(("|", "    ")):
            yield number, line


def anchors(page: Path) -> set[str]:
    """What links can name on a page: its headings, as GitHub spells them."""
    heads = [line.lstrip("# ") for _, line in prose(page) if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_are_short(page: Path) -> None:
    assert [number for number, line in prose(page) if len(line) > LONGEST_LINE] == []


def test_front_pages_are_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= LONGEST_FRONT_PAGE
    assert len((ROOT / "CONTRIBUTING.md").read_text().splitlines()) <= LONGEST_CONTRIBUTING


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in _LINK.findall(page.read_text()):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        other = (page.parent / name).resolve() if name else page
        assert other.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(other), f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_files_exist(page: Path) -> None:
    for name in _FILE.findall(page.read_text()):
        assert (ROOT / name).exists() or (ROOT / "src" / "dfcgs_codec" / name).exists(), (
            f"{page.name}: {name}"
        )


def test_every_page_is_linked() -> None:
    linked = {
        (page.parent / target.partition("#")[0]).resolve()
        for page in PAGES
        for target in _LINK.findall(page.read_text())
    }
    assert {page for page in PAGES if "docs" in page.parts} <= linked
