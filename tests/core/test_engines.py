"""The C core decodes what numpy decodes, bit by bit, and refuses what it refuses for the same reason."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import random
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import DecoderLimits, GaussianCloud, decode_sequence, errors
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.codec.frame.salvage import salvage
from dfcgs_codec.core import engine
from dfcgs_codec.core.module import MODULE
from dfcgs_codec.model import registry
from dfcgs_codec.model.core_words import words_of
from tests.context_models import random_prior
from tests.helpers import ROOT
from tools.build_core import build
from tools.mutations import SMALL, mutated, streams

STREAMS = ROOT / "tests" / "conformance"
VALID = sorted((STREAMS / "valid").glob("*.dgs"))
UNCOMMON = sorted((STREAMS / "uncommon").glob("*.dgs"))
FAULTY = sorted((STREAMS / "faulty").glob("*.dgs"))
ARRAYS = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")

pytestmark = pytest.mark.skipif(not engine.has_core(), reason="wasmtime cannot be imported")


def digest(cloud: GaussianCloud) -> str:
    whole = hashlib.sha256()
    for name in ARRAYS:
        whole.update(np.ascontiguousarray(getattr(cloud, name)).tobytes())
    return whole.hexdigest()


def outcome(data: bytes, name: str, *, check: bool = True) -> list[tuple[object, ...]]:
    """Hash of the state and digest of the output of each frame; at the end what the file was refused for."""
    found: list[tuple[object, ...]] = []
    limits = DecoderLimits(max_memory=1 << 30)
    try:
        for frame in SequenceDecoder(io.BytesIO(data), engine=name, check=check, limits=limits).frames():
            found.append((digest(frame.cloud()), frame.state.hash().hex()))
    except errors.DfcgsError as error:
        text = str(error) if isinstance(error, errors.ResourceLimit) else ""
        found.append((type(error).__name__, error.offset, text))
    return found


@pytest.mark.parametrize("path", [*VALID, *UNCOMMON, *FAULTY], ids=lambda path: path.stem)
def test_conformance_streams(path: Path) -> None:
    data = path.read_bytes()
    assert outcome(data, "core") == outcome(data, "numpy")


@pytest.mark.parametrize("first", range(0, 100, 10))
def test_broken_streams(first: int) -> None:
    for seed in range(first, first + 10):
        rng = random.Random(seed)
        data = mutated(rng, rng.choice(streams(SMALL)))
        for check in (True, False):
            assert outcome(data, "core", check=check) == outcome(data, "numpy", check=check), seed


@pytest.mark.parametrize("seed", range(20))
def test_random_legal_streams(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    legal_streams = pytest.importorskip("lab.legal_streams")
    model = random_prior(seed=seed)
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(model)
    data = legal_streams.random_file(seed, model)
    found = outcome(data, "core")
    assert found == outcome(data, "numpy")
    assert len(found) == 6


@pytest.mark.parametrize("name", ["births_and_deaths", "escapes", "verbatim_sh1", "input_order_sh1"])
def test_frames_outlive_the_next_one(name: str) -> None:
    data = (STREAMS / "valid" / f"{name}.dgs").read_bytes()
    kept = list(SequenceDecoder(io.BytesIO(data), engine="core").frames())
    expected = [found[:2] for found in outcome(data, "numpy")]
    assert [(digest(frame.cloud()), frame.state.hash().hex()) for frame in kept] == expected


def test_parts_and_salvage() -> None:
    data = (STREAMS / "valid" / "every_gof_a_frame.dgs").read_bytes()
    found = {}
    for name in engine.ENGINES:
        part = [frame.state.hash() for frame in SequenceDecoder(io.BytesIO(data), engine=name).frames(1, 3)]
        damaged = bytearray(data)
        damaged[len(data) // 2] ^= 0xFF
        losses: list[str] = []
        saved = [(f.index, f.state.hash()) for f in salvage(io.BytesIO(damaged), losses, engine=name)]
        found[name] = (part, saved, losses)
    assert found["core"] == found["numpy"]
    assert found["core"][2]


# --- which one decodes ------------------------------------------------------------------------------------


def engine_of(name: str, wanted: str | None = None) -> str:
    data = (STREAMS / "valid" / f"{name}.dgs").read_bytes()
    return SequenceDecoder(io.BytesIO(data), engine=wanted).engine


def test_the_core_decodes_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(engine.VARIABLE, raising=False)
    assert engine_of("motion") == "core"
    assert engine_of("motion", "numpy") == "numpy"
    monkeypatch.setenv(engine.VARIABLE, "numpy")
    assert engine_of("motion") == "numpy"
    assert engine_of("motion", "core") == "core"


def test_numpy_decodes_what_the_core_does_not_know() -> None:
    assert engine_of("escapes_paper", "core") == "numpy"


def test_numpy_decodes_where_wasmtime_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(engine.VARIABLE, raising=False)
    monkeypatch.setattr(engine, "has_core", lambda: False)
    assert engine_of("motion") == "numpy"
    with pytest.raises(errors.InputError, match="wasmtime"):
        engine_of("motion", "core")


def test_unknown_engines_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    path = STREAMS / "valid" / "motion.dgs"
    with pytest.raises(errors.InputError, match='"core" or "numpy"'):
        decode_sequence(path, engine="cuda")
    monkeypatch.setenv(engine.VARIABLE, "cuda")
    with pytest.raises(errors.InputError, match="cuda"):
        list(decode_sequence(path))


# --- the module -------------------------------------------------------------------------------------------


@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")
def test_the_module_is_made_of_these_sources(tmp_path: Path) -> None:
    build(tmp_path / "core.wasm")
    assert (tmp_path / "core.wasm").read_bytes() == MODULE.read_bytes()


def test_the_module_is_small() -> None:
    assert MODULE.stat().st_size < 300_000


@pytest.fixture
def words(tmp_path: Path) -> tuple[Path, str]:
    """The default prior as a file of words, and its hash."""
    model = registry.context_model(registry.DEFAULT_PRIOR)
    data = words_of(model)
    assert data is not None
    path = tmp_path / "words"
    path.write_bytes(data)
    return path, model.digest[:8].hex()


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_node_decodes_the_same(words: tuple[Path, str]) -> None:
    script = ROOT / "tests" / "core" / "decode.mjs"
    files = [path for path in VALID if engine_of(path.stem) == "core"]
    command = ["node", str(script), str(MODULE), str(words[0]), words[1], *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert [one["status"] for one in found] == [0] * len(files)
    expected = [[frame[0] for frame in outcome(path.read_bytes(), "numpy")] for path in files]
    assert [one["frames"] for one in found] == expected
