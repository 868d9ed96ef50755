"""Gaussians go, come and change places; their identity is found again, and kept."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from lab.options import encoder_options
from lab.small_clouds import FIELDS, make_cloud, real_cloud, shuffled, still, succeeding, travelling, waving
from tests.helpers import QUICK

INTRA_ONLY = replace(QUICK, gof_size=1)


def small(count: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    cloud = make_cloud(count, sh_degree, seed)
    return replace(cloud, scales=cloud.scales - 3)


def code(
    frames: list[GaussianCloud], folder: Path, options: EncoderOptions
) -> tuple[list[GaussianCloud], str, int]:
    """Decoded frames, their kinds, and the size of the file."""
    path = folder / "sequence.dgs"
    report = encode_sequence(frames, path, options, force=True)
    decoded = [frame.cloud() for frame in decode_sequence(path)]
    assert [cloud.num_gaussians for cloud in decoded] == [cloud.num_gaussians for cloud in frames]
    return decoded, "".join(frame.kind[0] for frame in report.frames), path.stat().st_size


def nearest_distance(cloud: GaussianCloud, decoded: GaussianCloud) -> float:
    """Largest distance from a Gaussian of `cloud` to the nearest decoded one, brute force."""
    apart = cloud.positions[:, None] - decoded.positions[None]
    return float(np.sqrt((apart**2).sum(axis=2)).min(axis=1).max())


@pytest.mark.parametrize(
    ("intra", "order", "shuffle"),
    [
        *itertools.product([IntraKind.CODED], OutputOrder, [True]),
        (IntraKind.CODED, OutputOrder.SEQUENCE, False),
        (IntraKind.PLY, OutputOrder.INPUT, True),
    ],
)
def test_births_and_deaths_are_p_frames(
    intra: IntraKind, order: OutputOrder, shuffle: bool, tmp_path: Path
) -> None:
    frames = succeeding(small(400, 1), 4, shuffle=shuffle)
    options = encoder_options(order=order, intra=intra, control_spacing=20, qp=20)
    decoded, kinds, _ = code(frames, tmp_path, options)
    assert kinds == "IPPP"
    for cloud, found in zip(frames, decoded, strict=True):
        if order == OutputOrder.INPUT:
            assert np.abs(cloud.positions - found.positions).max() < 0.01
            # steps are coarser for what shows less
            assert np.quantile(np.abs(cloud.sh_rest - found.sh_rest), 0.9) < 0.1
        else:
            assert nearest_distance(cloud, found) < 0.02


def test_survivors_keep_their_order(tmp_path: Path) -> None:
    """By colour, which is constant: those of one frame come in the order in which they came before."""
    frames = succeeding(small(300), 5, shuffle=True)
    decoded, _, _ = code(frames, tmp_path, EncoderOptions(qp=8))
    for before, after in itertools.pairwise(decoded):
        place = {tuple(color): i for i, color in enumerate(before.sh_dc.tolist())}
        places = [place[tuple(color)] for color in after.sh_dc.tolist() if tuple(color) in place]
        assert len(places) == 291
        assert places == sorted(places)


def test_an_order_lost_in_every_frame_costs_nothing(tmp_path: Path) -> None:
    options = encoder_options(qp=27, control_spacing=20)
    _, _, in_order = code(succeeding(small(1000), 5), tmp_path, options)
    _, _, lost = code(succeeding(small(1000), 5, shuffle=True), tmp_path, options)
    assert lost < 1.05 * in_order


def test_shuffled_frames_that_stand_still_are_skipped(tmp_path: Path) -> None:
    cloud = real_cloud(500)
    frames = [cloud, shuffled(cloud), cloud]
    decoded, kinds, _ = code(frames, tmp_path, QUICK)
    assert kinds == "Iss"
    for found in decoded[1:]:
        assert all(np.array_equal(getattr(found, f), getattr(decoded[0], f)) for f in FIELDS)


@pytest.mark.parametrize(
    "frames",
    [
        [small(200), small(150, 0, 7), small(150, 0, 8)],
        still(small(3), 2) + still(small(2), 2) + still(small(4), 1),
        [small(300), small(300, 0, 5).take(np.arange(40))],
        [make_cloud(1), make_cloud(2), make_cloud(1)],
    ],
)
def test_never_worse_than_i_frames(frames: list[GaussianCloud], tmp_path: Path) -> None:
    _, _, size = code(frames, tmp_path, QUICK)
    _, _, intra = code(frames, tmp_path, INTRA_ONLY)
    assert size <= 1.02 * intra


def test_many_go_and_many_come(tmp_path: Path) -> None:
    frames = succeeding(small(600), 3, share=0.4)
    decoded, kinds, _ = code(frames, tmp_path, EncoderOptions(qp=16))
    assert kinds[0] == "I"
    assert max(map(nearest_distance, frames, decoded)) < 0.05


def test_only_births_and_only_deaths(tmp_path: Path) -> None:
    everyone = small(500)
    frames = [everyone.take(np.arange(n)) for n in (300, 300, 400, 500, 350, 350)]
    frames = [waving(cloud, 0.03 * index) for index, cloud in enumerate(frames)]
    decoded, kinds, _ = code(frames, tmp_path, EncoderOptions(order=OutputOrder.INPUT, qp=12))
    assert kinds[3] == "P"
    for cloud, found in zip(frames, decoded, strict=True):
        assert np.abs(cloud.positions - found.positions).max() < 0.01


def test_info_counts_gaussians(tmp_path: Path) -> None:
    everyone = small(400)
    frames = [everyone.take(np.arange(n)) for n in (400, 380, 390)]
    code(frames, tmp_path, QUICK)
    found = probe(tmp_path / "sequence.dgs").frames
    assert [frame.num_gaussians for frame in found] == [400, 380, 390]
    assert all("TOPOLOGY" in frame.attribute_bytes for frame in found[1:])


def test_identity_survives_large_steps(tmp_path: Path) -> None:
    """A scene that travels several times the distance of its Gaussians between frames, order lost."""
    frames = [shuffled(cloud, seed) for seed, cloud in enumerate(travelling(small(400), 3, 0.8))]
    _, kinds, _ = code(frames, tmp_path, QUICK)
    assert kinds == "IPP"


def coming(count: int) -> list[GaussianCloud]:
    """Half of a trained splat, then all of it, and then nothing changes."""
    cloud = real_cloud(count)
    return [cloud.take(np.arange(0, count, 2)), *still(cloud, 3)]


@pytest.mark.parametrize("order", OutputOrder)
def test_births_have_steps_of_their_own_and_settle(order: OutputOrder, tmp_path: Path) -> None:
    path = tmp_path / "coming.dgs"
    frames = coming(1200)
    # too little to be coded, but enough to be looked at
    rng = np.random.default_rng(0)
    for index in (2, 3):
        moved = frames[index].rotations + rng.normal(0, 1e-5, frames[index].rotations.shape)
        frames[index] = replace(frames[index], rotations=moved.astype(np.float32))
    report = encode_sequence(frames, path, EncoderOptions(qp=26, order=order))
    assert "".join(frame.kind[0] for frame in report.frames)[:2] == "IP"
    # under the axis names that their coding gives them nothing is left to mend
    sizes = [frame.num_bytes for frame in report.frames]
    assert max(sizes[2:]) < 0.12 * sizes[1]
    assert probe(path).bytes_by("attribute")["COVER"] > 0
    uniform = tmp_path / "uniform.dgs"
    encode_sequence(frames, uniform, encoder_options(qp=26, order=order, visibility=False))
    assert path.stat().st_size < uniform.stat().st_size


def test_births_cost_what_they_cost_in_an_i_frame(tmp_path: Path) -> None:
    path, whole = tmp_path / "coming.dgs", tmp_path / "whole.dgs"
    frames = coming(3000)[:2]
    encode_sequence(frames, path, EncoderOptions(qp=26))
    encode_sequence(frames[1:], whole, EncoderOptions(qp=26))
    births = probe(path).frames[1].num_bytes
    assert births < 0.65 * whole.stat().st_size
