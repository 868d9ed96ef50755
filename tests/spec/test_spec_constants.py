"""Constants: the file, the tables of the text and the code have the same."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from dfcgs_codec.bitstream import constants
from dfcgs_codec.bitstream.constants import (
    Attribute,
    ChunkType,
    IntraKind,
    OutputOrder,
    Precision,
    Profile,
    Tool,
)
from dfcgs_codec.entropy import tables
from dfcgs_codec.model import registry
from tests import spec_decoder
from tests.spec.checks import CONSTANTS, DATA, MODELS, SPEC

#: modules, enumerations or values of the code that the constants of a section are compared with
_HOMES: dict[str, tuple[Any, ...]] = {
    "1.4": ("bitstream.io",),
    "3": ("bitstream.constants",),
    "3.1": (ChunkType,),
    "4.1": ("bitstream.sequence_header",),
    "4.2": (Profile, OutputOrder, Precision, IntraKind, Attribute),
    "6.1": (Tool,),
    "8": ({a.name: n for a, n in constants.STATE_COLUMNS.items()},),
    "8.3": ("transform.companding",),
    "9.2": ("transform.lod",),
    "9.5": ("codec.state.visibility",),
    "9.6": ("codec.intra.steps", "codec.intra.walk"),
    "9.7": ("transform.companding",),
    "9.8": ("transform.trellis",),
    "10.1": ("entropy.coder",),
    "10.4": ("entropy.tables",),
    "10.5": (tables.Shape, {"INVERSE_SIGMAS": np.array(tables._inverse_sigmas())}),
    "10.8": ("entropy.symbols",),
    "11.1": ("codec.intra.positions",),
    "11.2": ("codec.columns.column", "codec.columns.side_information"),
    "11.5": ("codec.intra.turns", "transform.pole"),
    "12.1": ("codec.residual.walk",),
    "14": ("transform.control_points", "codec.motion.field", "codec.motion.followers"),
    "17.1": ("model.context_model",),
    "18.1": ({str(level): tuple(limits) for level, limits in constants.LEVELS.items()},),
    "A.1": ("codec.intra.verbatim",),
    "B.3": ("model.layers", "transform.normalisation"),
    "B.4": ("codec.paper.latent_motion", "model.hash_grid"),
    "B.5": ("model.latent_model",),
    "B.7": ("transform.spreading",),
}

_DIGESTS = {"SCALE_TABLES_DIGEST": "scale_tables.bin", "SPLIT_TABLES_DIGEST": "split_tables.bin"}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return int.from_bytes(value, "big")
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return value


def _members(home: Any) -> dict[str, Any]:
    if isinstance(home, str):
        return vars(importlib.import_module(f"dfcgs_codec.{home}"))
    return dict(home) if isinstance(home, dict) else {member.name: member.value for member in home}


@pytest.mark.parametrize("section", CONSTANTS)
def test_constants_are_those_of_the_code(section: str) -> None:
    homes = [_members(home) for home in _HOMES[section]]
    for name, value in CONSTANTS[section].items():
        if name not in _DIGESTS:
            found = [_plain(home[key]) for home in homes for key in (name, f"_{name}") if key in home]
            assert value in found, name


def test_every_constant_of_the_bitstream_is_in_the_file() -> None:
    code = {
        name for name, value in vars(constants).items() if name.isupper() and isinstance(value, (int, bytes))
    }
    assert code == set(CONSTANTS["3"])
    for section, homes in _HOMES.items():
        named = {name for home in homes if not isinstance(home, str) for name in _members(home)}
        assert named <= set(CONSTANTS[section]), section


def _text_tables() -> Iterator[tuple[str, str, str]]:
    """Section, name and value of each row of the text's tables of constants."""
    for heading, body in re.findall(r"^#{2,3} (.*)$((?:\n(?!#{2,3} ).*)*)", SPEC, re.MULTILINE):
        for table in re.findall(r"^\| name \| value \|.*\n\|.*\n((?:\|.*\n)+)", body, re.MULTILINE):
            for line in table.splitlines():
                name, value = (cell.strip() for cell in line.split("|")[1:3])
                yield heading.split(" ")[0], name, value


def test_tables_of_the_text_are_those_of_the_file() -> None:
    rows = list(_text_tables())
    assert len(rows) > 60
    for section, name, text in rows:
        value = CONSTANTS[section][name]
        if text.endswith(" values"):
            assert len(value) == int(text.split()[0]), name
        else:
            found = tuple(int(part, 0) for part in text.split(","))
            assert value == (found if len(found) > 1 else found[0]), name


def test_reach_is_that_of_the_code() -> None:
    rows = re.findall(r"^\| (GAUSSIAN|LAPLACE|HEAVY) \|.*\| (\d+) \|$", SPEC, re.MULTILINE)
    assert {name: int(twice) for name, twice in rows} == {s.name: 2 * r for s, r in tables._REACH.items()}


def _digest(models: Iterator[list[int]]) -> int:
    data = b"".join(struct.pack(f"<{len(frequencies)}I", *frequencies) for frequencies in models)
    return int.from_bytes(hashlib.blake2b(data, digest_size=16).digest(), "big")


def test_scale_tables_are_those_of_the_text() -> None:
    bases = [(shape, scale) for shape in range(3) for scale in range(64)]
    for shape, scale in bases[::7]:
        code = tables.scale_table(tables.Shape(shape), scale).tolist()
        assert spec_decoder.scale_model(shape, scale).frequencies() == code
    digest = CONSTANTS["10.5"]["SCALE_TABLES_DIGEST"]
    assert _digest(spec_decoder.scale_model(*base).frequencies() for base in bases) == digest
    assert (
        _digest(tables.scale_table(tables.Shape(shape), scale).tolist() for shape, scale in bases) == digest
    )


def test_split_tables_are_those_of_the_text() -> None:
    cases = [(bias, count) for bias in range(16) for count in range(2, 33)]
    digest = CONSTANTS["10.5"]["SPLIT_TABLES_DIGEST"]
    assert _digest(spec_decoder.split_model(*case).frequencies() for case in cases) == digest
    assert _digest(tables.split_table(*case).tolist() for case in cases) == digest


@pytest.mark.parametrize("name", _DIGESTS)
def test_files_of_tables_have_their_digest(name: str) -> None:
    data = (DATA / _DIGESTS[name]).read_bytes()
    found = hashlib.blake2b(data, digest_size=16).digest()
    assert int.from_bytes(found, "big") == CONSTANTS["10.5"][name]


def test_the_text_names_every_model() -> None:
    rows = re.findall(r"^\| `([\w.-]+)` \| ([0-9a-f]{16}) \|", SPEC, re.M)
    found = {name: spec_decoder.model_hash(arrays).hex()[:16] for name, arrays in MODELS.items()}
    assert dict(rows) == found
    assert {name: registry.installed(name).digest.hex()[:16] for name in found} == found
