from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.encoder.matching.descriptors import match_bits
from dfcgs_codec.encoder.matching.matching import match
from dfcgs_codec.encoder.matching.nearest import certain_pairs, mutual, tree
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import MOTIONS, SceneOptions, permuted_with_ids, trained_sequence
from lab.small_clouds import (
    FIELDS,
    clustered_cloud,
    coincident_cloud,
    make_cloud,
    real_cloud,
    shuffled,
    untracked,
    with_outliers,
)
from tests.helpers import turns

#: more than the sample that is searched first
COUNT = 5000


@dataclass(frozen=True)
class Case:
    """Two frames; `truth` (N_now,) are the right partners, `moved` (N_before, 3) the true displacements."""

    before: GaussianCloud
    now: GaussianCloud
    truth: Int64
    moved: Float64

    def precision(self, partner: Int64) -> float:
        return float((partner == self.truth)[partner >= 0].mean())

    def recall(self, partner: Int64) -> float:
        return float((partner == self.truth)[self.truth >= 0].mean())


def twisted(cloud: GaussianCloud, angle: float) -> GaussianCloud:
    """Turned about the y axis by `angle` radians per unit of height; each Gaussian turns along."""
    height = cloud.positions[:, 1:2] - cloud.positions[:, 1].min()
    turn = Rotation.from_rotvec(angle * height * np.array([0.0, 1.0, 0.0]))
    quaternions = (turn * turns(cloud)).as_quat()[:, [3, 0, 1, 2]]
    return replace(
        cloud,
        positions=turn.apply(cloud.positions).astype(np.float32),
        rotations=quaternions.astype(np.float32),
    )


def noisy(cloud: GaussianCloud, share: float, amount: float = 1.0) -> GaussianCloud:
    """Every attribute of a share of the Gaussians changed by what is usual in semi-tracked sequences."""
    rng = np.random.default_rng(11)
    rows = rng.random(cloud.num_gaussians) < share
    size = float(np.ptp(cloud.positions, axis=0).max())
    deviations = {
        "positions": 5e-4 * size,
        "rotations": 0.01,
        "scales": 0.02,
        "opacities": 0.1,
        "sh_dc": 0.02,
        "sh_rest": 0.01,
    }
    changed = {}
    for name, deviation in deviations.items():
        values = getattr(cloud, name).copy()
        values[rows] += amount * deviation * rng.standard_normal(values[rows].shape)
        changed[name] = values
    return GaussianCloud(**changed)


def case(before: GaussianCloud, now: GaussianCloud, replaced: float = 0.0) -> Case:
    """Tracked frames in another order and sign of quaternions; a share of either has no partner."""
    rng = np.random.default_rng(12)
    n = before.num_gaussians
    gone = round(replaced * n)
    old, new = (rng.permutation(n)[gone:] for _ in range(2))
    place = np.full(n, -1)
    place[old] = np.arange(len(old))
    moved = now.positions[old].astype(np.float64) - before.positions[old]
    after = now.take(new)
    signs = rng.choice(np.array([-1, 1], np.float32), (len(new), 1))
    return Case(before.take(old), replace(after, rotations=after.rotations * signs), place[new], moved)


def alike(cloud: GaussianCloud) -> GaussianCloud:
    """Nothing but the positions tells the Gaussians apart."""
    return replace(cloud.take(np.zeros(cloud.num_gaussians, np.int64)), positions=cloud.positions)


def joined(first: GaussianCloud, second: GaussianCloud) -> GaussianCloud:
    return GaussianCloud(**{f: np.concatenate([getattr(first, f), getattr(second, f)]) for f in FIELDS})


def spacing(cloud: GaussianCloud) -> float:
    return float(np.median(cKDTree(cloud.positions).query(cloud.positions, k=[2])[0]))


def check_one_to_one(found: Case, partner: Int64) -> None:
    assert partner.dtype == np.int64
    assert partner.shape == (found.now.num_gaussians,)
    matched = partner[partner >= 0]
    assert partner.min() >= -1
    assert len(np.unique(matched)) == len(matched)
    assert (matched < found.before.num_gaussians).all()


def test_the_same_gaussians_in_another_order_after_large_motion() -> None:
    before = real_cloud(COUNT)
    lost = case(before, twisted(before, 0.2))
    assert np.median(np.linalg.norm(lost.moved, axis=1)) > 2 * spacing(before)
    assert np.array_equal(match(lost.before, lost.now), lost.truth)


@pytest.mark.parametrize("amount", [0.01, 6.0])
def test_the_amount_of_noise_is_measured(amount: float) -> None:
    before = real_cloud(COUNT)
    lost = case(before, noisy(twisted(before, 0.05), 1.0, amount))
    assert lost.recall(match(lost.before, lost.now)) >= 0.99


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_noise_on_some_or_all_with_births_and_deaths(share: float) -> None:
    before = real_cloud(COUNT)
    lost = case(before, noisy(twisted(before, 0.1), share), 0.01)
    assert np.median(np.linalg.norm(lost.moved, axis=1)) > spacing(before)
    partner = match(lost.before, lost.now)
    check_one_to_one(lost, partner)
    assert lost.precision(partner) >= 0.998
    assert lost.recall(partner) >= 0.998


def test_permuted_semi_tracked_sequence() -> None:
    clean = trained_sequence(real_cloud(COUNT), SceneOptions(5), "twist")
    frames = list(permuted_with_ids(clean, seed=2))
    for (before, old), (now, new) in islice(pairwise(frames), 1, 4):
        place = {identity: row for row, identity in enumerate(old.tolist())}
        truth = np.array([place.get(identity, -1) for identity in new.tolist()])
        found = Case(before, now, truth, np.zeros((len(old), 3)))
        partner = match(before, now)
        check_one_to_one(found, partner)
        assert found.precision(partner) >= 0.998
        assert found.recall(partner) >= 0.998


def test_births_stay_births_beside_their_parents() -> None:
    before = real_cloud(COUNT)
    lost = case(before, noisy(twisted(before, 0.1), 1.0, 4.0), 0.03)
    parents = lost.now.take(np.arange(0, lost.now.num_gaussians, 80))
    children = replace(parents, scales=parents.scales - 0.3, opacities=parents.opacities - 1)
    partner = match(lost.before, joined(lost.now, children))
    born = partner[lost.now.num_gaussians :]
    assert np.count_nonzero(born >= 0) <= 3
    survivors = partner[: lost.now.num_gaussians]
    assert lost.recall(survivors) >= 0.99
    assert np.count_nonzero(survivors[lost.truth < 0] >= 0) <= 3


def test_clones_do_not_share_a_partner() -> None:
    before = make_cloud(COUNT)
    lost = case(before, noisy(before, 1.0))
    twice = joined(lost.now, noisy(lost.now, 1.0, 0.2))
    partner = match(lost.before, twice)
    check_one_to_one(replace(lost, now=twice), partner)
    one, other = partner.reshape(2, -1)
    assert np.mean(np.maximum(one, other) == lost.truth) >= 0.8


def test_some_change_far_more_than_the_others() -> None:
    before = real_cloud(COUNT)
    lost = case(before, noisy(noisy(twisted(before, 0.05), 1.0, 0.1), 0.2, 6.0), 0.01)
    partner = match(lost.before, lost.now)
    assert lost.precision(partner) >= 0.998
    assert lost.recall(partner) >= 0.998


def test_a_few_that_change_among_more_births_and_deaths() -> None:
    before = real_cloud(COUNT)
    now = twisted(before, 0.05)
    lost = case(before, noisy(now, 0.003, 3.0), 0.01)
    assert np.count_nonzero(match_bits(lost.before, lost.now)[lost.truth >= 0] < 0) >= 8
    partner = match(lost.before, lost.now)
    assert lost.recall(partner) == 1.0
    assert lost.precision(partner) >= 0.999


def test_untracked_frames_give_next_to_nothing() -> None:
    for before, now in pairwise([*untracked(3000, 2), clustered_cloud(3000), clustered_cloud(3000, 0, 9)]):
        assert np.count_nonzero(match(before, now) >= 0) <= 0.02 * 3000


def test_a_motion_of_the_whole_scene_beyond_its_size() -> None:
    before = real_cloud(COUNT)
    away = replace(before, positions=before.positions + np.array([50, 0, -20], np.float32))
    lost = case(before, noisy(away, 1.0))
    assert lost.recall(match(lost.before, lost.now)) >= 0.999


def test_outliers_do_not_matter() -> None:
    before = with_outliers(make_cloud(COUNT), 40)
    lost = case(before, noisy(before, 1.0, 0.1))
    assert np.array_equal(match(lost.before, lost.now), lost.truth)


class TestMoved:
    """A prediction of the displacements, right or wrong."""

    def test_it_finds_what_nothing_else_can(self) -> None:
        before = alike(real_cloud(COUNT))
        there = twisted(before, 0.1).positions + np.array([3, 0, 0], np.float32)
        indistinct = case(before, replace(before, positions=there), 0.01)
        assert indistinct.recall(match(indistinct.before, indistinct.now)) < 0.5
        moved = indistinct.moved + 0.01 * spacing(before) * make_cloud(len(indistinct.moved)).positions
        partner = match(indistinct.before, indistinct.now, moved)
        assert indistinct.recall(partner) > 0.99
        moved[::50] = np.nan
        assert indistinct.recall(match(indistinct.before, indistinct.now, moved)) > 0.99

    @pytest.mark.parametrize("factor", [-1.0, 0.0, 1e6])
    def test_a_wrong_one_does_no_harm(self, factor: float) -> None:
        before = real_cloud(COUNT)
        lost = case(before, noisy(twisted(before, 0.1), 1.0), 0.01)
        wrong = factor * lost.moved * np.random.default_rng(4).standard_normal((len(lost.moved), 1))
        partner = match(lost.before, lost.now, wrong)
        assert lost.precision(partner) >= 0.998
        assert lost.recall(partner) >= 0.998

    def test_one_that_knows_nothing_changes_nothing(self) -> None:
        before = real_cloud(COUNT)
        lost = case(before, noisy(twisted(before, 0.1), 1.0), 0.01)
        unknown = match(lost.before, lost.now, np.full_like(lost.moved, np.nan))
        assert np.array_equal(unknown, match(lost.before, lost.now))


class TestDegenerate:
    """Small, coincident and identical."""

    @pytest.mark.parametrize("count", [1, 2, 3, 9, 100])
    def test_few(self, count: int) -> None:
        before = make_cloud(count, 1)
        lost = case(before, noisy(before, 1.0, 0.1))
        assert np.array_equal(match(lost.before, lost.now), lost.truth)
        assert np.array_equal(match(before, before), np.arange(count))

    def test_different_counts(self) -> None:
        cloud = make_cloud(100)
        assert match(cloud, cloud.take(np.array([7]))).tolist() == [7]
        back = match(cloud.take(np.array([7])), cloud)
        assert back[7] == 0
        assert np.count_nonzero(back >= 0) == 1

    def test_doubles_are_matched_one_to_one(self) -> None:
        cloud = make_cloud(50)
        twice = cloud.take(np.repeat(np.arange(50), 2))
        partner = match(twice, shuffled(twice))
        assert np.array_equal(np.sort(partner), np.arange(100))
        assert np.array_equal(twice.positions[partner], shuffled(twice).positions)

    def test_the_same_appearance_at_several_places(self) -> None:
        """Each appearance is there ten times: positions must tell."""
        own = make_cloud(COUNT)
        before = replace(own.take(np.arange(COUNT) // 10), positions=own.positions)
        lost = case(before, twisted(before, 0.01))
        assert np.count_nonzero(match_bits(lost.before, lost.now) >= 0) < 0.1 * COUNT
        assert lost.recall(match(lost.before, lost.now)) >= 0.999

    def test_appearance_tells_coincident_ones_apart(self) -> None:
        before = coincident_cloud(COUNT)
        lost = case(before, noisy(before, 1.0))
        still = replace(lost.now, positions=lost.now.positions * 0 + before.positions[:1])
        assert lost.recall(match(lost.before, still)) >= 0.98

    def test_all_the_same(self) -> None:
        cloud = alike(coincident_cloud(1000))
        assert np.array_equal(match(cloud, cloud.take(np.arange(990))), np.arange(990))

    @pytest.mark.timeout(15)
    def test_no_quadratic_time(self) -> None:
        """Most of them at one place and alike, which one by one would take half a minute."""
        half, rest = alike(coincident_cloud(25_000)), make_cloud(15_000)
        now = joined(replace(half, opacities=half.opacities + 0.1), noisy(rest, 1.0, 0.1))
        partner = match(joined(half, rest), now)
        assert np.mean(partner[25_000:] == np.arange(25_000, 40_000)) >= 0.98


class TestNearest:
    """Search among features."""

    def test_many_next_to_one_are_no_pairs(self) -> None:
        rng = np.random.default_rng(5)
        old = 1000 * rng.standard_normal((600, 13))
        first, second = certain_pairs([old], old[0] + rng.standard_normal((600, 13)))
        assert len(first) == len(second) == 0

    def test_the_better_version_is_taken(self) -> None:
        rng = np.random.default_rng(5)
        new = rng.standard_normal((600, 13))
        for olds in ([new + 0.01, -new], [-new, new + 0.01]):
            first, second = certain_pairs(olds, new)
            assert len(first) >= 0.9 * len(new)
            assert np.array_equal(first, second)

    def test_a_tree_holds_few_of_a_crowd(self) -> None:
        crowd = np.zeros((1000, 3))
        spread = np.arange(300.0).reshape(100, 3)
        rows = tree(np.concatenate([crowd, spread, crowd + 0.5]), 1.0)[1]
        assert np.count_nonzero((rows < 1000) | (rows >= 1100)) <= 16
        assert np.array_equal(rows[(rows >= 1000) & (rows < 1100)], np.arange(1000, 1100))

    def test_out_of_reach(self) -> None:
        new = np.arange(5.0)[:, None] * 100
        first, second, distance = mutual(new + np.array([[3.0], [4.9], [5.1], [0.0], [7.0]]), new, 5.0)
        assert first.tolist() == second.tolist() == [0, 1, 3]
        assert np.allclose(distance, [3.0, 4.9, 0.0])


class TestBits:
    """Keys of attributes that stayed bit for bit."""

    @pytest.mark.parametrize(
        "kept", [("scales",), ("sh_dc", "sh_rest"), ("positions",), ("scales", "opacities")]
    )
    def test_what_stayed_is_enough(self, kept: tuple[str, ...]) -> None:
        before = make_cloud(500, 1)
        other = make_cloud(500, 1, seed=1)
        lost = case(before, replace(other, **{name: getattr(before, name) for name in kept}))
        assert np.array_equal(match_bits(lost.before, lost.now), lost.truth)

    def test_opacity_alone_is_not(self) -> None:
        before = make_cloud(500)
        now = replace(make_cloud(500, seed=1), opacities=before.opacities)
        assert (match_bits(before, now) == -1).all()

    def test_values_that_many_share_tell_nothing(self) -> None:
        """Scales from a small table agree by chance."""
        table = make_cloud(5000).scales
        rng = np.random.default_rng(3)
        before, now = (
            replace(make_cloud(3000, seed=i), scales=table[rng.integers(0, 5000, 3000)]) for i in (1, 2)
        )
        assert (match_bits(before, now) == -1).all()

    def test_zero_has_no_sign(self) -> None:
        old, other = make_cloud(20), make_cloud(20, seed=1)
        zero = np.array([0, 1, 1], np.float32)
        before = replace(old, scales=old.scales * zero)
        now = replace(other, scales=old.scales * -zero)
        now = replace(now, scales=np.where(now.scales == 0, now.scales, -now.scales))
        assert np.signbit(now.scales[:, 0]).any() != np.signbit(before.scales[:, 0]).any()
        assert np.array_equal(match_bits(before, now), np.arange(20))


def test_the_same_twice() -> None:
    before = real_cloud(COUNT)
    lost = case(before, noisy(twisted(before, 0.2), 0.5, 3.0), 0.05)
    assert np.array_equal(match(lost.before, lost.now), match(lost.before, lost.now))


def test_every_motion_of_the_generator() -> None:
    for name in MOTIONS:
        before, now = list(trained_sequence(real_cloud(1500), SceneOptions(3), name))[1:]
        lost = case(before, noisy(now, 1.0, 0.3))
        assert lost.recall(match(lost.before, lost.now)) >= 0.99
