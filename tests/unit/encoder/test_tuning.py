"""Every switch for experiments says what it is for, and is heeded."""

from __future__ import annotations

import ast
import dataclasses
import re
from itertools import pairwise
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions, EncoderTuning
from dfcgs_codec.encoder.plan import options, tuning

FOLDER = Path(tuning.__file__).parents[1]


def documented(module: Path, name: str) -> set[str]:
    """Fields of a class that a text follows."""
    (found,) = (
        n for n in ast.parse(module.read_text()).body if isinstance(n, ast.ClassDef) and n.name == name
    )
    return {
        field.target.id
        for field, text in pairwise(found.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }


@pytest.mark.parametrize("kind", [EncoderOptions, EncoderTuning])
def test_every_field_is_documented(kind: type) -> None:
    module = Path(options.__file__ if kind is EncoderOptions else tuning.__file__)
    assert documented(module, kind.__name__) == {field.name for field in dataclasses.fields(kind)}


def test_every_switch_is_heeded() -> None:
    sources = [path.read_text() for path in FOLDER.rglob("*.py")]
    heeded = {name for text in sources for name in re.findall(r"\btuning\.(\w+)", text)}
    for field in dataclasses.fields(EncoderTuning):
        assert {field.name, f"{field.name}_log2"} & heeded, field.name
