"""P-frames with the frozen prior, whatever its weights: the same state, whoever decodes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import Profile
from dfcgs_codec.codec.residual.classes import AttributeActivity
from dfcgs_codec.errors import ModelMismatch
from dfcgs_codec.model import registry
from lab.options import encoder_options
from lab.small_clouds import all_changing, drifting, make_cloud, real_cloud, succeeding, waving
from tests.context_models import random_prior
from tests.helpers import QUICK

MOVING = {"control_spacing": 15}


@pytest.fixture(autouse=True)
def _priors() -> Iterator[None]:
    registry.register(random_prior())
    yield
    registry._registered.clear()


def small(count: int, sh_degree: int = 0) -> GaussianCloud:
    cloud = make_cloud(count, sh_degree)
    return replace(cloud, scales=cloud.scales - 3)


def sequences() -> dict[str, tuple[list[GaussianCloud], dict]]:
    return {
        "noise": (drifting(real_cloud(300), 4), {}),
        "everything": (all_changing(make_cloud(150, 2), 4), {}),
        "motion": ([waving(small(300), 0.1 * i) for i in range(4)], MOVING),
        "births": (succeeding(small(400), 5), MOVING),
        "few": (all_changing(make_cloud(5), 3), {}),
        "many": (drifting(make_cloud(2500), 3), {"gof_size": 2}),
        "uniform": (all_changing(make_cloud(100, 1), 3), {"visibility": False}),
    }


def coded(frames: list[GaussianCloud], path: Path, **options: object) -> list[GaussianCloud]:
    """What comes out again, hashes checked."""
    encode_sequence(frames, path, encoder_options(QUICK, **options), force=True)  # type: ignore[arg-type]
    return [frame.cloud() for frame in decode_sequence(path)]


@pytest.mark.parametrize("name", list(sequences()))
@pytest.mark.parametrize("model", [None, "random-prior"])
def test_any_prior_leads_to_what_the_encoder_had(name: str, model: str | None, tmp_path: Path) -> None:
    frames, options = sequences()[name]
    decoded = coded(frames, tmp_path / "a.dgs", model_id=model, **options)
    assert [cloud.num_gaussians for cloud in decoded] == [cloud.num_gaussians for cloud in frames]


def test_bytes_do_not_depend_on_the_number_of_processes(tmp_path: Path) -> None:
    frames = drifting(real_cloud(200), 7)
    for jobs in (1, 2):
        coded(frames, tmp_path / f"{jobs}.dgs", jobs=jobs, gof_size=3)
    assert (tmp_path / "1.dgs").read_bytes() == (tmp_path / "2.dgs").read_bytes()


def test_models_of_the_other_profile_are_refused(tmp_path: Path) -> None:
    frames = drifting(real_cloud(50), 2)
    for profile, model in ((Profile.MAIN, "paper-1"), (Profile.PAPER, "main-1")):
        with pytest.raises(ModelMismatch, match=f"not one of profile {profile.name.lower()}"):
            coded(frames, tmp_path / "a.dgs", profile=profile, model_id=model)


def test_memory_fades_by_a_quarter() -> None:
    rng = np.random.default_rng(0)
    before = AttributeActivity.none(40, 3)
    memory, running = [[0] * 3 for _ in range(40)], [0] * 40
    for _ in range(5):
        symbols = rng.integers(-9, 10, (40, 3))
        before = AttributeActivity(symbols, before.density, before.magnitude).remembering(before)
        for i, row in enumerate(symbols.tolist()):
            running[i] += (min(sum(map(abs, row)), 1 << 20) << 2) - (running[i] >> 2)
            changed = [m - 16 * s for m, s in zip(memory[i], row, strict=True)]
            memory[i] = [m - (m >> 2) for m in changed]
    assert before.memory is not None
    assert before.running is not None
    assert before.memory.tolist() == memory
    assert before.running.tolist() == running
