"""Whole files: the package against the decoder of the text."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from lab.legal_streams import random_cloud, random_file
from lab.options import encoder_options
from tests import spec_decoder
from tests.spec.checks import CONFORMANCE, MODELS, check_file, random_prior, random_sequence


@pytest.mark.parametrize(
    ("count", "sh_degree", "order", "intra"),
    [
        (1, 0, OutputOrder.SEQUENCE, IntraKind.CODED),
        (40, 0, OutputOrder.INPUT, IntraKind.CODED),
        (77, 1, OutputOrder.FREE, IntraKind.CODED),
        (130, 1, OutputOrder.SEQUENCE, IntraKind.CODED),
        (200, 0, OutputOrder.INPUT, IntraKind.CODED),
        (66, 2, OutputOrder.INPUT, IntraKind.CODED),
        (70, 0, OutputOrder.INPUT, IntraKind.PLY),
        (50, 3, OutputOrder.SEQUENCE, IntraKind.PLY),
    ],
)
def test_encoded_sequences(
    tmp_path: Path, count: int, sh_degree: int, order: OutputOrder, intra: IntraKind
) -> None:
    rng = np.random.default_rng(count)
    target = tmp_path / "sequence.dgs"
    options = encoder_options(order=order, intra=intra, gof_size=4)
    encode_sequence(random_sequence(rng, count, sh_degree), target, options)
    assert len(check_file(target.read_bytes())) == 6


def test_all_levels_of_detail(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    cloud = random_cloud(rng, 8300, 0)
    # smooth over space, so that neighbours are worth using
    smooth = np.sin(3 * cloud.positions @ rng.normal(size=(3, 3))).astype(np.float32)
    cloud = replace(cloud, sh_dc=smooth, scales=smooth - 4)
    target = tmp_path / "sequence.dgs"
    encode_sequence([cloud], target, EncoderOptions(order=OutputOrder.INPUT))
    check_file(target.read_bytes())


@pytest.mark.parametrize(
    "path",
    [path for kind in ("valid", "uncommon") for path in sorted((CONFORMANCE / kind).glob("*.dgs"))],
    ids=lambda path: path.stem,
)
def test_conformance_streams(path: Path) -> None:
    expected = json.loads((CONFORMANCE / "expected.json").read_text(encoding="utf-8"))
    hashes = [frame.hex() for frame in check_file(path.read_bytes())]
    assert hashes == expected[path.parent.name][path.stem]["frame_hashes"]


FAULTY_BY_TEXT = (
    "rotation_symbol_too_large",
    "step_too_large",
    "alternating_positions",
    "too_many_control_points",
)


@pytest.mark.parametrize("name", FAULTY_BY_TEXT)
def test_faulty_streams_are_refused_by_the_text_alone(name: str) -> None:
    """Before any hash is looked at."""
    data = (CONFORMANCE / "faulty" / f"{name}.dgs").read_bytes()
    with pytest.raises(spec_decoder.Refused):
        list(spec_decoder.Decoder(data, MODELS).frames())


@pytest.mark.parametrize("seed", range(30))
def test_random_choices(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model, models = random_prior(seed, monkeypatch)
    check_file(random_file(seed, model), models)


def test_index_leads_to_every_gof(tmp_path: Path) -> None:
    target = tmp_path / "sequence.dgs"
    encode_sequence(random_sequence(np.random.default_rng(3), 60, 0), target, EncoderOptions(gof_size=2))
    data = target.read_bytes()
    all_frames = [frame.frame_hash for frame in spec_decoder.Decoder(data, MODELS).frames()]
    for start in range(6):
        assert [f.state.hash() for f in decode_sequence(target, start, start + 1)] == [all_frames[start]]
