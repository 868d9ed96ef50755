"""P-frames of profile PAPER: the walk, what moves, what is refined."""

from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps
from dfcgs_codec.bitstream.motion_header import LatentHeader, SpreadHeader
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.motion.compensation import ControlSource
from dfcgs_codec.codec.paper.latent_motion import (
    LatentControl,
    LatentReference,
    appearance_of,
    code_hyper,
    code_latents,
    spread_over,
)
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.model.latent_model import LatentModel, latents_of
from dfcgs_codec.transform.rotation import ONE, from_float, normalise
from lab.small_clouds import make_cloud
from tests.latent_models import random_model

UNITS = UnitExponents(-14, -12, -14, -12)
STEPS = IntraSteps(dict.fromkeys(Attribute, 16), 0, dict.fromkeys(Attribute, 0), 0, frozenset())


def state(count: int = 600, sh_degree: int = 2) -> GofState:
    planes = state_of(make_cloud(count, sh_degree, 3), UNITS).planes
    control = ControlHeader(10, 3)
    return GofState.of_intra(FrameState(planes), control, STEPS, UNITS, None)


def reference(model: LatentModel | None = None, sh_degree: int = 2) -> LatentReference:
    return LatentReference(model or random_model(), state(sh_degree=sh_degree), UNITS)


HEADER = LatentHeader(60, 0, SpreadHeader(30, -10))


@pytest.mark.parametrize("seed", range(3))
def test_latents_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(seed=seed)
    hyper = rng.normal(0, 12, (50, 16)).astype(np.int64)
    hyper[rng.random((50, 16)) < 0.02] *= 1000
    coder = SymbolWriter()
    code_hyper(coder, hyper, model, 50)
    reader = SymbolReader(coder.getvalue())
    np.testing.assert_array_equal(code_hyper(reader, None, model, 50), hyper)
    reader.finish()
    indices = rng.integers(0, 160, (50, 16))
    symbols = np.rint(rng.normal(0, 2 ** ((indices - 26) / 6)) * 2).astype(np.int64)
    coder = SymbolWriter()
    code_latents(coder, symbols, indices)
    reader = SymbolReader(coder.getvalue())
    np.testing.assert_array_equal(code_latents(reader, None, indices), symbols)
    reader.finish()


def test_no_control_points_cost_nothing() -> None:
    coder = SymbolWriter()
    assert code_hyper(coder, np.zeros((0, 16), np.int64), random_model(), 0).shape == (0, 16)
    assert code_latents(coder, np.zeros((0, 16), np.int64), np.zeros((0, 16), np.int64)).shape == (0, 16)
    assert not coder.getvalue()


@pytest.mark.parametrize("step_log2", [-4, -1, 0, 2, 6])
def test_scale_indices_follow_the_step(step_log2: int) -> None:
    model, rng = random_model(gain=60), np.random.default_rng(1)
    prior, hyper = rng.integers(-20000, 20000, (40, 16)), rng.integers(-9, 9, (40, 16))
    mean, indices = model.distribution(hyper, prior, 0)
    other_mean, other = model.distribution(hyper, prior, step_log2)
    np.testing.assert_array_equal(mean, other_mean)
    inside = (indices > 0) & (indices < 159) & (other > 0) & (other < 159)
    assert inside.any()
    assert set((indices - other)[inside].tolist()) == {6 * step_log2}


def test_a_latent_is_its_mean_and_whole_steps() -> None:
    mean = np.array([[5, -70, 32000]])
    assert latents_of(np.array([[0, 2, 100]]), mean, 1).tolist() == [[5, 2 * 128 - 70, 32767]]
    assert latents_of(np.array([[-3, 1 << 40, -(1 << 40)]]), mean, -4).tolist() == [[-7, 32767, -32767]]


def test_motion_is_spread_over_neighbours_only() -> None:
    ref = reference()
    latents = np.zeros((60, 16), np.int64)
    latents[7] = 9000
    still = ref.moved(HEADER, np.zeros_like(latents))
    moved = ref.moved(HEADER, latents)
    changed = (moved.planes[Attribute.POSITION].values != still.planes[Attribute.POSITION].values).any(axis=1)
    assert 0 < changed.sum() <= 30
    assert changed[ref.rows[7]]


def test_motion_follows_the_size_of_the_scene() -> None:
    """The same latents move a scene of twice the size twice as far."""
    model = random_model()
    small = state()
    planes = dict(small.frame.planes)
    planes[Attribute.POSITION] = type(planes[Attribute.POSITION])(planes[Attribute.POSITION].wide() * 2)
    control = ControlHeader(10, 4)
    large = GofState.of_intra(FrameState(planes), control, STEPS, UNITS, None)
    latents = np.random.default_rng(1).integers(-3000, 3000, (60, 16))
    went = []
    for found, exponent in ((small, -10), (large, -10)):
        ref = LatentReference(model, found, UNITS)
        moved = ref.moved(LatentHeader(60, 0, SpreadHeader(30, exponent)), latents)
        went.append(moved.planes[Attribute.POSITION].wide() - found.frame.planes[Attribute.POSITION].wide())
    assert np.abs(went[0]).max() > 50
    assert np.abs(went[1] - 2 * went[0]).max() <= 2


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_appearance_has_56_columns(sh_degree: int) -> None:
    frame = state(20, sh_degree).frame
    found = appearance_of(frame, UNITS, 2)
    assert found.shape == (20, 56)
    known = 11 + (0, 9, 24, 45)[sh_degree]
    assert found[:, known - 1].any()
    assert not found[:, known:].any()
    np.testing.assert_array_equal(found[:, 8:11], frame.planes[Attribute.SH_DC].wide())
    scale = frame.planes[Attribute.SCALE].wide() / 2**12
    np.testing.assert_allclose(found[:, :3] / 2**12, (scale - 2 * np.log(2)) / 4, atol=1e-3)


@pytest.mark.parametrize("sh_degree", [0, 2])
def test_refinement_changes_colours_above_degree_0_only(sh_degree: int) -> None:
    ref = reference(sh_degree=sh_degree)
    before = state(sh_degree=sh_degree).frame
    after = ref.refined(before)
    changed = {a for a in before.planes if (before.planes[a].values != after.planes[a].values).any()}
    assert changed == ({Attribute.SH_1, Attribute.SH_2} if sh_degree else set())


def test_the_prior_of_some_is_that_of_all() -> None:
    ref = reference()
    np.testing.assert_array_equal(ref.prior(ref.rows), ref.prior()[ref.rows])


# --- spreading ------------------------------------------------------------------------------------------


def _scene(count: int) -> FrameState:
    cloud = make_cloud(count, 0, 0)
    positions = np.rint(cloud.positions * 5000).astype(np.int64)
    planes = {Attribute.POSITION: positions, Attribute.ROTATION: from_float(cloud.rotations)}
    return FrameState({attribute: Plane(values) for attribute, values in planes.items()})


def _source(frame: FrameState, spacing: int, shift: int = 2) -> LatentControl:
    return LatentControl(ControlSource(frame.planes[Attribute.POSITION], ControlHeader(spacing, shift)))


def test_no_motion_changes_no_bit() -> None:
    frame = _scene(400)
    moved = spread_over(
        np.zeros((20, 7), np.int64), _source(frame, 20).spreading(SpreadHeader(30, -4)), frame
    )
    assert moved.hash() == frame.hash()
    assert moved.planes[Attribute.ROTATION] is frame.planes[Attribute.ROTATION]


def test_motion_is_spread_as_the_paper_has_it() -> None:
    frame = _scene(400)
    source = _source(frame, 20)
    cells, points = source.points
    motions = np.random.default_rng(1).integers(-4000, 4000, (len(points), 7))
    motions[:, 3:] *= 1000
    moved = spread_over(motions, source.spreading(SpreadHeader(30, -4)), frame)
    total = np.zeros((400, 7))
    for point, motion in zip(points, motions, strict=True):
        apart = np.linalg.norm((cells - cells[point]).astype(float), axis=1)
        nearest = np.lexsort((np.arange(400), apart))[:30]
        share = np.exp(-apart[nearest] / 16)
        total[nearest] += np.outer(share / share.sum(), motion)
    went = moved.planes[Attribute.POSITION].wide() - frame.planes[Attribute.POSITION].wide()
    assert np.abs(went - total[:, :3]).max() < 0.02 * 4000
    turned = frame.planes[Attribute.ROTATION].wide() + total[:, 3:]
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    assert np.abs(moved.planes[Attribute.ROTATION].wide() / ONE - turned).max() < 0.01


def test_the_largest_motions_stay_on_the_grid() -> None:
    positions = np.zeros((40, 3), np.int64)
    positions[:, 0] = STATE_LIMIT - np.arange(40)
    rotations = np.tile([ONE, 0, 0, 0], (40, 1))
    frame = FrameState({Attribute.POSITION: Plane(positions), Attribute.ROTATION: Plane(rotations)})
    spreading = _source(frame, 1, 0).spreading(SpreadHeader(1, 0))
    most = 2 * STATE_LIMIT
    moved = spread_over(np.tile([most, -most, most, -most, most, -most, most], (40, 1)), spreading, frame)
    assert (moved.planes[Attribute.POSITION].values == [STATE_LIMIT, -STATE_LIMIT, STATE_LIMIT]).all()
    # w is gone, all else is as large as it gets
    found = moved.planes[Attribute.ROTATION].wide()
    assert (found == normalise(np.array([[0, ONE, -ONE, ONE]]))).all()


def test_a_rotation_that_would_vanish_stays() -> None:
    frame = _scene(50)
    source = _source(frame, 1, 0)
    gone = -frame.planes[Attribute.ROTATION].wide()[source.points[1]]
    motions = np.concatenate([np.zeros((len(gone), 3), np.int64), gone], axis=1)
    assert spread_over(motions, source.spreading(SpreadHeader(1, 0)), frame).hash() == frame.hash()
