"""Weights and their hashes: what is installed, what is refused."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.errors import ModelMismatch
from dfcgs_codec.model import registry
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.model.layers import LayerError
from dfcgs_codec.model.registry import DEFAULT_MODEL, installed, load_model, model_of_stream, register
from dfcgs_codec.model.weights_file import digest_of, read_arrays, write_arrays
from tests.latent_models import random_arrays, random_model


@pytest.fixture(autouse=True)
def _nothing_stays_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", {})


def test_the_digest_is_that_of_the_text() -> None:
    arrays = {"b": np.array([[1, -2]], np.int16), "a": np.array([3], np.int64)}
    content = (
        b"a\0<i8\0(1,)\0" + bytes([3, 0, 0, 0, 0, 0, 0, 0]) + b"b\0<i2\0(1, 2)\0" + bytes([1, 0, 254, 255])
    )
    assert digest_of(arrays) == hashlib.sha256(content).digest()
    assert digest_of({"g": np.zeros(1, np.int8)}) == hashlib.sha256(b"g\0|i1\0(1,)\0\0").digest()


def test_the_digest_knows_neither_byte_order_nor_memory_layout() -> None:
    values = np.arange(6, dtype=np.int32).reshape(2, 3)
    other = np.asfortranarray(values.astype(">i4"))
    assert digest_of({"x": values}) == digest_of({"x": other})
    assert digest_of({"x": values}) != digest_of({"x": values.reshape(3, 2)})
    assert digest_of({"x": values}) != digest_of({"y": values})


def test_a_file_is_a_model(tmp_path: Path) -> None:
    arrays = random_arrays(5)
    write_arrays(tmp_path / "some-model.weights", arrays)
    model = load_model(tmp_path / "some-model.weights")
    assert (model.model_id, model.digest) == ("some-model", digest_of(arrays))
    found = read_arrays(tmp_path / "some-model.weights")
    assert sorted(found) == sorted(arrays)
    for name, array in found.items():
        assert array.dtype == arrays[name].dtype
        assert np.array_equal(array, arrays[name])


def test_damaged_files_are_no_models(tmp_path: Path) -> None:
    path = tmp_path / "some-model.weights"
    write_arrays(path, {"a": np.array([3], np.int64), "b": np.array([[1, -2]], np.int16)})
    data = path.read_bytes()
    for damaged in (data[:-1], data[:20], data + b"c", data.replace(b"<i2", b"<O2")):
        path.write_bytes(damaged)
        with pytest.raises(LayerError, match="no"):
            read_arrays(path)


def test_models_are_found_by_id_and_hash() -> None:
    model = random_model("mine")
    with pytest.raises(ModelMismatch, match="mine"):
        installed("mine")
    register(model)
    assert model_of_stream("mine", model.digest[:8]) is model
    with pytest.raises(ModelMismatch, match=model.digest[:8].hex()):
        model_of_stream("mine", bytes(8))


@pytest.mark.parametrize("name", ["", "../latent_model", "/etc/passwd", "paper-1.weights", "PAPER-1", "*"])
def test_names_are_never_paths(name: str) -> None:
    with pytest.raises(ModelMismatch, match="not installed"):
        installed(name)


def test_the_model_of_the_package_is_what_its_description_says() -> None:
    folder = Path(registry.__file__).with_name("weights")
    described = json.loads((folder / f"{DEFAULT_MODEL}.json").read_text())
    model = installed(DEFAULT_MODEL)
    assert (described["model_id"], described["sha256"]) == (DEFAULT_MODEL, model.digest.hex())
    assert model.has_hyperprior
    assert model.has_refinement
    assert model.grid is not None
    assert set(described["nets"]) == set(model.networks)
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1 << 20


def test_parts_that_a_model_may_lack() -> None:
    bare = random_model(without=("hyper_synthesis", "hyper_analysis", "grid_context", "refinement"))
    assert not bare.has_hyperprior
    assert not bare.has_refinement
    assert bare.grid is None


@pytest.mark.parametrize("name", ["synthesis", "fusion", "analysis"])
def test_parts_that_it_needs(name: str) -> None:
    with pytest.raises(LayerError, match=name):
        random_model(without=(name,))


def test_wrong_shapes_are_refused() -> None:
    arrays = random_arrays()
    del arrays["fusion.1.bias"]
    with pytest.raises(LayerError, match=r"fusion\.1 lacks"):
        LatentModel.of_arrays("x", arrays)
    arrays = random_arrays()
    arrays["hyper_frequencies"] = arrays["hyper_frequencies"][:, 1:]
    with pytest.raises(LayerError, match="factorised"):
        LatentModel.of_arrays("x", arrays)
    arrays = random_arrays()
    arrays["synthesis.1.weight"] = arrays["synthesis.1.weight"][:5]
    arrays["synthesis.1.bias"] = arrays["synthesis.1.bias"][:5]
    with pytest.raises(LayerError, match="synthesis is 16 to 5 wide"):
        LatentModel.of_arrays("x", arrays)
