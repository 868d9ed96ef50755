"""Sections that code and text cite exist."""

from __future__ import annotations

import json
import re

import pytest

from tests.spec.checks import CONFORMANCE, ROOT, SPEC

_HEADINGS = set(re.findall(r"^#{2,4} (?:Annex )?([\dA-D]+(?:\.\d+)*)[ :]", SPEC, re.MULTILINE))


def _cited(text: str) -> set[str]:
    found: set[str] = set()
    text = " ".join(text.split())
    found |= set(re.findall(r"spec annex ([A-D](?:\.\d)?)", text))
    for phrase in re.findall(r"spec sections? ([\d., and to]*\d)", text):
        numbers = re.findall(r"\d+(?:\.\d+)?", phrase)
        if " to " in phrase:
            numbers = [str(n) for n in range(int(numbers[0]), int(numbers[-1]) + 1)]
        found |= set(numbers)
    return found


def test_cited_sections_exist() -> None:
    sources = [*(ROOT / "src").rglob("*.py"), *(ROOT / "tools").rglob("*.py")]
    cited = {number: path.name for path in sources for number in _cited(path.read_text(encoding="utf-8"))}
    assert {number: name for number, name in cited.items() if number not in _HEADINGS} == {}
    assert {"1.4", "8.5", "9.4", "11.3", "A"} <= set(cited)


def test_links_of_the_contents_lead_to_headings() -> None:
    headings = re.findall(r"^#{2,4} (.*)$", SPEC, re.MULTILINE)
    anchors = {re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]*)\)", SPEC)) <= anchors


def test_references_inside_the_text_exist() -> None:
    prose = re.sub(r"```.*?```|`[^`]*`", "", SPEC, flags=re.DOTALL)
    referred = set(re.findall(r"\((\d{1,2}(?:\.\d)?)(?:, \d+(?:\.\d)?)?\)", prose))
    referred |= set(re.findall(r"(?:[Ss]ections?|[Cc]hapters?) (\d+(?:\.\d+)?)", prose))
    referred |= set(re.findall(r"\b([A-D]\.\d)\b", prose))
    assert {number for number in referred if number not in _HEADINGS} == set()


@pytest.mark.parametrize("annex", ["A", "B"])
def test_annexes_name_the_files_that_need_them(annex: str) -> None:
    start = SPEC.index(f"## Annex {annex}")
    named = re.search(r"these\s+files need it:(.*?)\. ", SPEC[start:], re.DOTALL)
    assert named is not None
    valid = json.loads((CONFORMANCE / "expected.json").read_text(encoding="utf-8"))["valid"]
    assert set(re.findall(r"`(\w+)`", named[1])) == {n for n, v in valid.items() if annex in v["annexes"]}
