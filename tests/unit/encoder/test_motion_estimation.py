from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.motion.followers import BLEND, Binding
from dfcgs_codec.encoder.motion.motion_estimation import measure
from dfcgs_codec.transform.control_points import GATHER_WEIGHT_BITS, Gathering

POINTS = 30


def binding_of(count: int, random: np.random.Generator) -> Binding:
    first = random.integers(0, POINTS, count)
    ranks = np.stack([(first + 7 * i) % POINTS for i in range(4)])
    weights = random.integers(0, 1000, (4, count))
    weights[3] = (1 << GATHER_WEIGHT_BITS) - weights[:3].sum(axis=0)
    choice = random.integers(0, 5, count)
    return Binding(Gathering(ranks, weights), np.zeros((5, count), np.int32), choice)


@pytest.mark.parametrize("count", [1, 300, 20_000])
@pytest.mark.parametrize("is_trusted", [False, True])
def test_moments_are_sums_over_those_that_are_carried(count: int, is_trusted: bool) -> None:
    random = np.random.default_rng(count)
    binding = binding_of(count, random)
    source, target = random.normal(0, 1000, (2, count, 3))
    trust = random.random(count) if is_trusted else None
    moments = measure(binding, source, target, POINTS, trust)
    x, y = source - source.mean(axis=0), target - source.mean(axis=0)
    products = np.einsum("ni,nj->nij", x, y).reshape(count, 9)
    columns = np.concatenate([np.ones((count, 1)), x, y, products], axis=1)
    if trust is not None:
        columns *= trust[:, None]
    expected = np.zeros((POINTS, 16))
    for candidate in range(4):
        share = (binding.gathering.weights[candidate] / (1 << GATHER_WEIGHT_BITS)) ** 2
        share = np.where(binding.choice == BLEND, share, binding.choice == candidate + 1)
        np.add.at(expected, binding.gathering.ranks[candidate], share[:, None] * columns)
    np.testing.assert_allclose(moments.sums, expected, rtol=1e-9, atol=1e-3)
    assert np.array_equal(moments.center, source.mean(axis=0))
