"""The encoder of profile PAPER, with models of random integers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, InputError, encode_sequence, probe
from dfcgs_codec.bitstream.constants import Attribute, IntraKind, Profile
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.codec.paper.latent_motion import LatentReference
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.encoder.paper.latent_coding import frequency_encoding
from dfcgs_codec.encoder.plan.quantiser_steps import Bound
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from dfcgs_codec.errors import CorruptBitstream, ModelMismatch
from dfcgs_codec.model import registry
from dfcgs_codec.model.registry import register
from dfcgs_codec.sequence import open_folder
from lab.options import encoder_options
from lab.small_clouds import make_cloud
from tests.helpers import QUICK, write_frames
from tests.latent_models import random_model

PAPER = encoder_options(QUICK, profile=Profile.PAPER, model_id="random")


@pytest.fixture(autouse=True)
def _model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", {})
    register(random_model())


def moving(cloud: GaussianCloud, count: int, amount: float = 0.05) -> list[GaussianCloud]:
    frames = []
    for index in range(count):
        offset = amount * index * np.sin(2 * cloud.positions[:, [1, 2, 0]])
        frames.append(replace(cloud, positions=cloud.positions + offset.astype(np.float32)))
    return frames


def encode(
    tmp_path: Path, frames: list[GaussianCloud], options: EncoderOptions = PAPER
) -> tuple[EncodeReport, Path]:
    folder, target = tmp_path / "frames", tmp_path / "out.dgs"
    write_frames(folder, frames)
    return encode_sequence(open_folder(folder), target, options, force=True), target


def decode(path: Path) -> list[GaussianCloud]:
    with path.open("rb") as file:
        return [frame.cloud() for frame in SequenceDecoder(file).frames()]


def test_what_is_decoded_is_what_was_coded(tmp_path: Path) -> None:
    frames = moving(make_cloud(500, 2, 3), 4)
    report, target = encode(tmp_path, frames, encoder_options(PAPER, refinement=RefinementMode.ON))
    assert [f.kind for f in report.frames] == ["I", "P", "P", "P"]
    # every hash is checked
    assert len(decode(target)) == 4
    header = probe(target).header
    assert (header.profile, header.model_id) == (Profile.PAPER, "random")
    assert header.model_hash == random_model().digest[:8]


@pytest.mark.parametrize(("share", "kind"), [(0.5, "P"), (1.9, "P"), (-0.1, "skip"), (2.1, "skip")])
def test_motion_is_used_only_where_it_leads_nearer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float, kind: str
) -> None:
    """As if the network moved everything by `share` of the way to its target."""

    def moved(self: LatentReference, header: object, latents: object) -> FrameState:
        frame = self._state.frame
        positions = frame.planes[Attribute.POSITION].wide()
        planes = dict(frame.planes)
        planes[Attribute.POSITION] = Plane(positions + np.int64(share * 1000))
        return replace(frame, planes=planes)

    monkeypatch.setattr(LatentReference, "moved", moved)
    cloud = make_cloud(100, 0, 3)
    header = probe(encode(tmp_path, [cloud])[1]).header
    step = np.float32(1000 * 2.0**header.unit_exponents.position)
    report, target = encode(tmp_path, [cloud, replace(cloud, positions=cloud.positions + step)])
    assert [f.kind for f in report.frames] == ["I", kind]
    with target.open("rb") as file:
        first, second = (
            frame.state.planes[Attribute.POSITION].wide()
            for frame in SequenceDecoder(file, check=False).frames()
        )
    assert kind == "P" or not (first - second).any()


@pytest.mark.parametrize(("flung", "kind"), [(0, "P"), (1, "skip")])
def test_gaussians_that_are_flung_away_count_more_than_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flung: int, kind: str
) -> None:
    """All but one arrive at their targets; that one lands far away, where it may cover everything."""

    def moved(self: LatentReference, header: object, latents: object) -> FrameState:
        frame = self._state.frame
        positions = frame.planes[Attribute.POSITION].wide() + 1000
        positions[:flung] += 1 << 22
        return replace(frame, planes=dict(frame.planes) | {Attribute.POSITION: Plane(positions)})

    monkeypatch.setattr(LatentReference, "moved", moved)
    cloud = make_cloud(100, 0, 3)
    header = probe(encode(tmp_path, [cloud])[1]).header
    step = np.float32(1000 * 2.0**header.unit_exponents.position)
    report, _ = encode(tmp_path, [cloud, replace(cloud, positions=cloud.positions + step)])
    assert [f.kind for f in report.frames] == ["I", kind]


def test_gofs_have_ten_frames_unless_asked(tmp_path: Path) -> None:
    frames = moving(make_cloud(60, 0, 3), 12, 0.001)
    report, _ = encode(tmp_path, frames)
    assert [i for i, f in enumerate(report.frames) if f.kind == "I"] == [0, 10]
    report, _ = encode(tmp_path, frames, replace(PAPER, gof_size=4))
    assert [i for i, f in enumerate(report.frames) if f.kind == "I"] == [0, 4, 8]


def test_other_counts_are_i_frames(tmp_path: Path) -> None:
    cloud = make_cloud(90, 1, 3)
    report, target = encode(tmp_path, [cloud, cloud.take(np.arange(80)), cloud.take(np.arange(80))])
    assert [f.kind for f in report.frames] == ["I", "I", "skip"]
    assert [c.num_gaussians for c in decode(target)] == [90, 80, 80]


def test_what_else_changes_is_held_and_said(tmp_path: Path) -> None:
    cloud = make_cloud(90, 1, 3)
    brighter = replace(cloud, sh_dc=cloud.sh_dc + np.float32(0.5))
    report, target = encode(tmp_path, [cloud, brighter, brighter])
    assert report.held_frames == 1
    assert any("in 1 frames" in note for note in report.notes)
    first, second, _ = decode(target)
    np.testing.assert_array_equal(first.sh_dc, second.sh_dc)


@pytest.mark.parametrize("without", [("hyper_synthesis",), ("grid_context", "appearance"), ("refinement",)])
def test_models_that_lack_a_part(tmp_path: Path, without: tuple[str, ...]) -> None:
    register(random_model("part", without=without))
    options = encoder_options(PAPER, model_id="part", refinement=RefinementMode.ON, intra=IntraKind.PLY)
    report, target = encode(tmp_path, moving(make_cloud(300, 1, 3), 3), options)
    assert len(decode(target)) == len(report.frames) == 3
    chunks = probe(target).chunk_bytes
    if without == ("hyper_synthesis",):
        assert "HYPERPRIOR" not in chunks


@pytest.mark.parametrize("step", [1 / 16, 0.5, 4, 64])
def test_steps(tmp_path: Path, step: float) -> None:
    report, target = encode(
        tmp_path, moving(make_cloud(300, 0, 3), 2), encoder_options(PAPER, latent_step=step)
    )
    assert len(decode(target)) == len(report.frames)


@pytest.mark.parametrize("step", [0, -1, 3, 1 / 32, 128, float("nan"), float("inf")])
def test_other_steps_are_refused(step: float) -> None:
    with pytest.raises(InputError, match="latent_step"):
        encoder_options(PAPER, latent_step=step)


@pytest.mark.parametrize(
    "changes",
    [{"motion": MotionMode.OFF}, {"visibility": False}],
)
def test_options_of_the_other_profile_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="for --profile main alone"):
        encoder_options(PAPER, **changes)


@pytest.mark.parametrize("changes", [{"latent_step": 2}, {"refinement": RefinementMode.OFF}])
def test_options_of_this_profile_are_refused_elsewhere(changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="for --profile paper alone"):
        encoder_options(**changes)


def test_bounds_cannot_be_kept() -> None:
    with pytest.raises(InputError, match="--profile paper"):
        replace(PAPER, bounds=(Bound("position", 0.1),))


def test_a_model_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ModelMismatch, match="nowhere"):
        encode(tmp_path, [make_cloud(5)], encoder_options(PAPER, model_id="nowhere"))


def test_another_model_of_the_same_name_is_refused(tmp_path: Path) -> None:
    _, target = encode(tmp_path, moving(make_cloud(50, 0, 3), 2))
    register(random_model(seed=9))
    with pytest.raises(ModelMismatch, match="hash"):
        decode(target)


def test_refinement_that_the_model_lacks_is_refused(tmp_path: Path) -> None:
    options = encoder_options(PAPER, refinement=RefinementMode.ON)
    _, target = encode(tmp_path, moving(make_cloud(200, 1, 3), 2), options)
    with target.open("rb") as file:
        decoder = SequenceDecoder(file)
        model = random_model()
        networks = {name: net for name, net in model.networks.items() if name != "refinement"}
        decoder._model = replace(model, networks=networks)
        with pytest.raises(CorruptBitstream, match="REFINEMENT"):
            list(decoder.frames())


def test_frequencies_double_and_stay_within_12_bits() -> None:
    values = np.array([[0.0, 0.25, -1.0], [0.5, 1.0, 0.001]])
    found = frequency_encoding(values)
    assert found.shape == (2, 72)
    assert np.abs(found).max() == 4096
    np.testing.assert_array_equal(found[0, :6], [0, 2896, 0, 4096, 2896, -4096])
    np.testing.assert_array_equal(found[0, 6:12], [0, 4096, 0, 4096, 0, 4096])


def test_rotations_of_either_sign_are_the_same_motion(tmp_path: Path) -> None:
    cloud = make_cloud(300, 0, 3)
    frames = moving(cloud, 2)
    flipped = [frames[0], replace(frames[1], rotations=-frames[1].rotations)]
    _, target = encode(tmp_path, frames)
    plain = target.read_bytes()
    _, target = encode(tmp_path, flipped)
    with target.open("rb") as file:
        states = [frame.state for frame in SequenceDecoder(file).frames()]
    (tmp_path / "plain.dgs").write_bytes(plain)
    with (tmp_path / "plain.dgs").open("rb") as file:
        expected = [frame.state for frame in SequenceDecoder(file).frames()]
    for a, b in zip(states, expected, strict=True):
        np.testing.assert_array_equal(
            a.planes[Attribute.POSITION].values, b.planes[Attribute.POSITION].values
        )
