"""What the tests of the specification share: its text, its constants, and two decoders against each other."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import GaussianCloud
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.model import registry
from dfcgs_codec.model.context_model import ContextModel
from lab.legal_streams import random_cloud
from tests import spec_decoder
from tests.context_models import random_arrays as random_prior_arrays

ROOT = Path(__file__).resolve().parents[2]

SPEC = (ROOT / "bitstream_spec.md").read_text(encoding="utf-8")

MODELS = spec_decoder.published()

DATA = ROOT / "spec"


def _number(value: Any) -> Any:
    """A constant of the JSON file; what a double does not hold is a hexadecimal string."""
    if isinstance(value, list):
        return tuple(value)
    return int(value, 16) if isinstance(value, str) else value


CONSTANTS = {
    section: {name: _number(value) for name, value in found.items()}
    for section, found in json.loads((DATA / "constants.json").read_text(encoding="utf-8")).items()
}


def example_block(name: str) -> list[str]:
    match = re.search(rf"<!-- example: {name} -->\n\n```\n(.*?)\n```", SPEC, re.DOTALL)
    assert match is not None
    return match[1].splitlines()


def bytes_of(lines: list[str]) -> bytes:
    data = b""
    for line in lines:
        assert int(line[:4], 16) == len(data)
        data += bytes.fromhex(line[6:54])
    return data


def _moved(rng: np.random.Generator, cloud: GaussianCloud, share: float) -> GaussianCloud:
    rows = (rng.random(cloud.num_gaussians) < share)[:, None]
    turn = rng.normal(0, 0.05, (cloud.num_gaussians, 4)) * rows
    fade = rng.normal(0, 0.3, cloud.num_gaussians) * rows[:, 0]
    return replace(
        cloud,
        positions=cloud.positions + (rng.normal(0, 0.02, (cloud.num_gaussians, 3)) * rows).astype(np.float32),
        rotations=cloud.rotations + turn.astype(np.float32),
        opacities=cloud.opacities + fade.astype(np.float32) * (share < 1),
    )


def random_sequence(rng: np.random.Generator, count: int, sh_degree: int) -> list[GaussianCloud]:
    frames = [random_cloud(rng, count, sh_degree)]
    for share in (0.3, 0.3, 0.0, 1.0, 1.0):
        frames.append(_moved(rng, frames[-1], share))
    return frames


def _flat(sh_rest: np.ndarray) -> np.ndarray:
    return sh_rest.reshape(len(sh_rest), 3 * sh_rest.shape[2])


def _check_output(frame: Any, cloud: GaussianCloud) -> None:
    found = frame.output()
    expected = {
        **{name: cloud.positions[:, i] for i, name in enumerate("xyz")},
        **{f"scale_{i}": cloud.scales[:, i] for i in range(3)},
        **{f"rot_{i}": cloud.rotations[:, i] for i in range(4)},
        "opacity": cloud.opacities,
        **{f"f_dc_{i}": cloud.sh_dc[:, i] for i in range(3)},
        **{f"f_rest_{i}": v for i, v in enumerate(_flat(cloud.sh_rest).T)},
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(np.array(found[name], values.dtype), values, equal_nan=True), name


def check_file(data: bytes, models: Any = None) -> list[bytes]:
    """Hashes of all frames, the same in the file, in the package and in the decoder of the text."""
    package = list(SequenceDecoder(io.BytesIO(data)).frames())
    text = list(spec_decoder.Decoder(data, models or MODELS).frames())
    for ours, theirs in zip(text, package, strict=True):
        assert ours.state.hash() == theirs.state.hash(), f"frame {ours.index}"
        assert ours.frame_hash == ours.state.hash()
        assert ours.sequence.frame_numbers[ours.index] == theirs.number
        _check_output(ours, theirs.cloud())
    return [frame.frame_hash for frame in text]


CONFORMANCE = ROOT / "tests" / "conformance"


def as_text_reads(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    return {
        name: spec_decoder.Array(
            array.dtype.str.replace("=", "<"), tuple(array.shape), array.ravel().tolist()
        )
        for name, array in arrays.items()
    }


def random_prior(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[ContextModel, dict[str, Any]]:
    """A prior of random integers, registered, and as the text's decoder reads it."""
    arrays = random_prior_arrays(seed)
    model = ContextModel.of_arrays("random", arrays)
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(model)
    return model, {"random": as_text_reads(arrays)}
