from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.codec.motion.followers import BLEND, Binding, blend, efforts_of
from dfcgs_codec.encoder.motion.motion_estimation import chosen_moves
from dfcgs_codec.transform.control_points import Gathering
from dfcgs_codec.transform.rigid import RigidMotion


def four_apart(count: int = 50) -> tuple[Binding, RigidMotion, np.ndarray]:
    """Points that gather from four control points, each of which moves in a direction of its own."""
    ranks = np.repeat(np.arange(4)[:, None], count, axis=1)
    weights = np.repeat(np.array([2048, 1024, 512, 512])[:, None], count, axis=1)
    shifts = np.array([[1000, 0, 0], [0, 1000, 0], [0, 0, 1000], [-1000, 0, 0]])
    turns = np.array([[90, 0, 0], [0, 90, 0], [0, 0, 90], [0, 0, 0]])
    motion = RigidMotion(np.zeros((4, 3), np.int64), shifts, turns)
    positions = np.random.default_rng(0).integers(-900, 900, (3, count)).astype(np.float64)
    return Binding.of(Gathering(ranks, weights)), motion, positions


def test_at_first_all_follow_the_blend() -> None:
    binding, motion, positions = four_apart()
    moves = binding.moves(motion, positions)
    assert np.array_equal(binding.chosen(moves), moves[BLEND])
    # about 1000 * (2048 - 512, 1024, 512) / 4096, and the turns move a little
    assert np.abs(moves[BLEND] - np.array([[375], [250], [125]])).max() < 3
    assert binding.turns(motion)[0].tolist() == [45, 23, 11]


@pytest.mark.parametrize("leader", range(5))
def test_who_came_closest_leads(leader: int) -> None:
    binding, motion, positions = four_apart()
    moves = binding.moves(motion, positions)
    learnt = binding.learn(moves, moves[leader], step=8)
    assert (learnt.choice == leader).all()
    assert np.array_equal(learnt.chosen(moves), moves[leader])
    if leader:
        assert (learnt.turns(motion) == motion.vectors[leader - 1]).all()


def test_old_efforts_fade() -> None:
    binding, motion, positions = four_apart()
    moves = binding.moves(motion, positions)
    for _ in range(20):
        binding = binding.learn(moves, moves[1], step=8)
    frames = 0
    while (binding.choice == 1).all():
        binding = binding.learn(moves, moves[2], step=8)
        frames += 1
    assert 1 <= frames <= 4
    assert (binding.choice == 2).all()


def test_only_the_rows_given_learn() -> None:
    binding, motion, positions = four_apart()
    rows = np.array([3, 20, 21])
    part = binding.of_rows(rows)
    moves = part.moves(motion, positions[:, rows])
    learnt = binding.with_rows(rows, part.learn(moves, moves[4], step=8))
    assert np.flatnonzero(learnt.choice == 4).tolist() == rows.tolist()
    assert not np.delete(learnt.efforts, rows, axis=1).any()


def test_blend_rounds_to_nearest() -> None:
    weights = np.array([[4096, 2048], [0, 2048], [0, 0], [0, 0]])
    values = [np.array([-7.0, 3.0]), np.array([99.0, 4.0]), np.zeros(2), np.zeros(2)]
    assert blend(values, weights).tolist() == [-7.0, 4.0]


def test_errors_below_four_steps_do_not_matter() -> None:
    assert efforts_of(np.array([0.0, 31.0, 32.0, 64.0, 1e9]), 8).tolist()[:4] == [0, 0, 16, 48]


def test_moves_of_the_choice_alone_are_those_among_all() -> None:
    # more points than are looked at together
    binding, motion, positions = four_apart(20_000)
    learnt = replace(binding, choice=np.random.default_rng(2).integers(0, 5, 20_000))
    moves = binding.moves(motion, positions)
    assert np.array_equal(chosen_moves(learnt, motion, positions), learnt.chosen(moves))
    every_third = np.arange(0, 20_000, 3)
    assert np.array_equal(
        binding.of_rows(every_third).moves(motion, positions[:, every_third]), moves[:, :, every_third]
    )
    nobody = binding.of_rows(every_third[:0])
    assert chosen_moves(nobody, motion, positions[:, :0]).shape == (3, 0)


def test_long_arrays_are_as_their_rows() -> None:
    binding, motion, positions = four_apart(20_000)
    random = np.random.default_rng(3)
    binding = replace(binding, choice=random.integers(0, 5, 20_000))
    moves = binding.moves(motion, positions)
    actual = random.integers(-900, 900, (3, 20_000)).astype(np.float64)
    learnt, turns = binding.learn(moves, actual, step=8), binding.turns(motion)
    assert len(np.unique(learnt.choice)) > 1
    for rows in (np.arange(100), np.arange(8190, 8195), np.arange(19_990, 20_000)):
        part = binding.of_rows(rows)
        assert np.array_equal(part.turns(motion), turns[rows])
        alone = part.learn(moves[:, :, rows], actual[:, rows], step=8)
        assert np.array_equal(alone.efforts, learnt.efforts[:, rows])
        assert np.array_equal(alone.choice, learnt.choice[rows])
