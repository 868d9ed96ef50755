"""Annex B and chapter 17: networks and tables of random integers, and models that do not fit."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import BitstreamError, GaussianCloud, encode_sequence
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder, Profile
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.columns.magnitudes import log_of
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.encoder.paper.latent_coding import LatentCoder
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from dfcgs_codec.model import registry
from dfcgs_codec.model.latent_model import LatentModel
from lab.chunks import join_chunks, split_chunks
from lab.options import encoder_options
from lab.small_clouds import all_changing, drifting, make_cloud, real_cloud, still, succeeding, waving
from tests import spec_decoder
from tests.latent_models import random_arrays
from tests.spec.checks import as_text_reads, check_file, random_prior, random_sequence


@pytest.mark.parametrize(
    ("seed", "sh_degree", "without", "changes"),
    [
        (1, 0, (), {}),
        (2, 2, (), {"refinement": RefinementMode.ON, "latent_step": 0.5, "control_spacing": 9}),
        (3, 3, ("hyper_synthesis", "grid_context"), {"latent_step": 8, "num_neighbours": 5, "qp": 40}),
        (4, 1, ("appearance",), {"refinement": RefinementMode.ON, "intra": IntraKind.PLY, "gof_size": 2}),
        (5, 1, ("refinement",), {"latent_step": 1 / 16, "qp": 8}),
    ],
)
def test_networks(
    seed: int,
    sh_degree: int,
    without: tuple[str, ...],
    changes: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Networks of random integers, in every frame, whether they lead nearer or not."""
    arrays = random_arrays(seed, without=without, gain=40 * seed)
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(LatentModel.of_arrays("random", arrays))
    monkeypatch.setattr(LatentCoder, "_leads_nearer", lambda *_: True)
    frames = random_sequence(np.random.default_rng(seed), 150, sh_degree)[:4]
    target = tmp_path / "random.dgs"
    options = encoder_options(profile=Profile.PAPER, model_id="random", **({"control_spacing": 15} | changes))
    report = encode_sequence(frames, target, options)
    assert sum(frame.kind == "P" for frame in report.frames) >= 1
    check_file(target.read_bytes(), {"random": as_text_reads(arrays)})


def _small(count: int, sh_degree: int = 0) -> GaussianCloud:
    """Gaussians so small that motion is worth its bytes."""
    cloud = make_cloud(count, sh_degree, 3)
    return replace(cloud, scales=cloud.scales - 3)


def _waving(frames: list[GaussianCloud]) -> list[GaussianCloud]:
    return [waving(cloud, 0.1 * index) for index, cloud in enumerate(frames)]


_MOVING: dict[str, Any] = {"control_spacing": 15}

#: frames, and options of the encoder
PRIOR_SEQUENCES: dict[str, tuple[Callable[[], list[GaussianCloud]], dict[str, Any]]] = {
    "tracked": (lambda: drifting(real_cloud(300), 4), {}),
    "one": (lambda: drifting(make_cloud(1), 3), {}),
    "few": (lambda: all_changing(make_cloud(40, 1), 4), {}),
    "all attributes": (lambda: all_changing(make_cloud(200, 3), 3), {}),
    "uniform steps": (
        lambda: all_changing(make_cloud(150, 1), 4),
        {"visibility": False, "qp": 24},
    ),
    "several GoFs": (lambda: all_changing(make_cloud(100), 7), {"gof_size": 3}),
    "verbatim": (lambda: all_changing(make_cloud(100), 3), {"intra": IntraKind.PLY}),
    "motion": (lambda: _waving(still(_small(300), 5)), _MOVING),
    "motion and change": (lambda: _waving(all_changing(_small(400, 1), 4)), _MOVING),
    "births and deaths": (lambda: succeeding(_small(600), 4), {"control_spacing": 20}),
    "lost order": (
        lambda: succeeding(_small(300, 1), 4, shuffle=True),
        {**_MOVING, "order": OutputOrder.INPUT},
    ),
    "levels left out, few coded": (
        lambda: drifting(real_cloud(2300), 3, 0.05),
        {"motion": MotionMode.OFF},
    ),
    "levels left out, all coded": (lambda: all_changing(make_cloud(2112), 3), {"qp": 24}),
}


@pytest.mark.parametrize("name", PRIOR_SEQUENCES)
def test_priors(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Networks and tables of random integers."""
    make, changes = PRIOR_SEQUENCES[name]
    _, models = random_prior(sorted(PRIOR_SEQUENCES).index(name), monkeypatch)
    target = tmp_path / "random.dgs"
    report = encode_sequence(make(), target, encoder_options(model_id="random", **changes))
    assert sum(frame.kind == "P" for frame in report.frames) >= 2
    check_file(target.read_bytes(), models)


def test_logarithms_are_those_of_the_text() -> None:
    values = np.concatenate([np.arange(4096), (1 << np.arange(3, 62)) - 1, 1 << np.arange(62)])
    assert [spec_decoder.log(a) for a in values.tolist()] == log_of(values).tolist()


def _with_model(data: bytes, **changes: Any) -> bytes:
    """A file whose header names another model, or has another profile."""
    chunks = split_chunks(data)
    writer = ByteWriter()
    replace(SequenceHeader.read(ByteReader(chunks[0].payload)), **changes).write(writer)
    return join_chunks([replace(chunks[0], payload=writer.getvalue()), *chunks[1:]])


@pytest.mark.parametrize("profile", [Profile.MAIN, Profile.PAPER])
def test_models_that_do_not_fit(profile: Profile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prior, models = random_prior(0, monkeypatch)
    arrays = random_arrays(0)
    network = LatentModel.of_arrays("network", arrays)
    registry.register(network)
    models |= {"network": as_text_reads(arrays)}
    own, other = (prior, network) if profile == Profile.MAIN else (network, prior)
    target = tmp_path / "sequence.dgs"
    options = encoder_options(profile=profile, model_id=own.model_id)
    encode_sequence(drifting(make_cloud(20), 2), target, options)
    data = target.read_bytes()
    assert len(check_file(data, models)) == 2
    named = {"model_id": other.model_id, "model_hash": other.digest[:8]}
    refused: list[tuple[dict[str, Any], dict[str, Any]]] = [
        (named, models),
        ({"profile": Profile.PAPER if profile == Profile.MAIN else Profile.MAIN}, models),
        ({"model_id": "unknown"}, models),
        ({"model_hash": bytes(8)}, models),
        ({"model_hash": other.digest[:8]}, models),
        ({"model_id": ""}, models),
    ]
    for changes, known in refused:
        damaged = _with_model(data, **changes)
        with pytest.raises(BitstreamError) as caught:
            list(SequenceDecoder(io.BytesIO(damaged)).frames())
        assert caught.value.code == "model-mismatch"
        with pytest.raises(spec_decoder.ModelMismatch):
            list(spec_decoder.Decoder(damaged, known).frames())
