"""The float codec against the codec's own integers: inputs, rates by the frozen tables, compensation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch, from the train extra")

from dfcgs_codec.bitstream.constants import Attribute  # noqa: E402
from dfcgs_codec.codec.paper.latent_motion import spread_over  # noqa: E402
from dfcgs_codec.codec.state.planes import FrameState, Plane  # noqa: E402
from dfcgs_codec.entropy.tables import Shape, scale_table  # noqa: E402
from dfcgs_codec.transform.spreading import Spreading  # noqa: E402
from tests.training.paper_helpers import small_gof  # noqa: E402
from training.paper.coding import compensate, gaussian_bits, sigma_of  # noqa: E402
from training.paper.factorised import FactorisedModel  # noqa: E402
from training.paper.inputs import frequencies  # noqa: E402
from training.paper.samples import augmented, joined, product, sample_of  # noqa: E402


@pytest.mark.parametrize("scale", [10, 26, 40, 57])
def test_bits_of_latents_are_those_of_the_frozen_tables(scale):
    table = scale_table(Shape.GAUSSIAN, scale)
    reach = len(table) // 2
    symbols = np.arange(1 - reach, reach)
    sigma = sigma_of(torch.tensor([float(scale)]), torch.tensor([1.0]))
    found = gaussian_bits(torch.from_numpy(symbols.astype(np.float32)), sigma).numpy()
    expected = 24 - np.log2(table[1:-1])
    likely = expected < 14
    assert likely.sum() >= 1
    assert np.allclose(found[likely], expected[likely], atol=0.02)


def test_bits_far_from_the_mean_are_finite_and_pull_back():
    offsets = torch.tensor([0.0, 30.0, -500.0], requires_grad=True)
    bits = gaussian_bits(offsets, torch.tensor([0.05]))
    bits.sum().backward()
    assert bits[0] < 1e-3
    assert torch.isfinite(bits).all()
    assert offsets.grad[1] > 1
    assert offsets.grad[2] < -1


def test_a_coarser_step_is_six_scales_an_octave():
    scales = torch.tensor([40.0])
    assert sigma_of(scales, torch.tensor([4.0])) == sigma_of(scales - 12, torch.tensor([1.0]))


def test_the_factorised_model_is_a_distribution():
    torch.manual_seed(1)
    model = FactorisedModel(3)
    values = torch.arange(-60.0, 61.0)[:, None].expand(121, 3)
    assert np.allclose(torch.exp2(-model.bits(values)).sum(0).detach(), 1, atol=1e-3)


def test_frequencies_stand_octave_by_octave_sines_first():
    values = torch.tensor([[0.25, -0.5, 0.1]], dtype=torch.float64)
    found = frequencies(values)[0].numpy()
    assert found.shape == (72,)
    for octave in range(12):
        angles = [math.pi * 2.0**octave * v for v in (0.25, -0.5, 0.1)]
        expected = [math.sin(a) for a in angles] + [math.cos(a) for a in angles]
        assert np.allclose(found[6 * octave : 6 * octave + 6], expected, atol=2.0**-13 + 1e-9)


def test_compensation_is_the_codecs():
    gof = small_gof()
    sample = sample_of(gof, everyone=True)
    rng = np.random.default_rng(0)
    spread = rng.normal(0, 0.3, (len(gof.control), 7))
    unit = 2.0 ** int(gof.extent_log2)
    integers = np.rint(spread * np.array([unit] * 3 + [2.0**24] * 4)).astype(np.int64)
    planes = {Attribute.POSITION: Plane(gof.positions[0]), Attribute.ROTATION: Plane(gof.rotations[0])}
    moved = spread_over(integers, Spreading(gof.neighbours, gof.weights), FrameState(planes))
    first = sample.positions[0], sample.rotations[0]
    positions, rotations = compensate(sample, torch.from_numpy(spread).float(), *first)
    expected = (moved.planes[Attribute.POSITION].values - gof.centre) / unit
    assert np.abs(expected - sample.positions[0].numpy()).max() > 0.01
    assert np.allclose(positions.numpy(), expected, atol=2 / unit + 1e-6)
    assert np.allclose(rotations.numpy(), moved.planes[Attribute.ROTATION].values / 2.0**24, atol=1e-6)


def test_reached_gaussians_are_enough_for_motion():
    whole, reached = (sample_of(small_gof(), everyone=everyone) for everyone in (True, False))
    assert reached.positions.shape[1] < whole.positions.shape[1]
    assert torch.equal(whole.positions[:, whole.control], reached.positions[:, reached.control])
    assert torch.equal(whole.positions[2][whole.neighbours], reached.positions[2][reached.neighbours])


def test_augmentation_keeps_motion_rigidly_related():
    sample = sample_of(small_gof())
    changed = augmented(sample, np.random.default_rng(2))
    assert torch.equal(changed.neighbours, sample.neighbours)
    lengths = changed.rotations.norm(dim=2)
    assert torch.allclose(lengths, torch.ones_like(lengths), atol=1e-5)
    # of the four names of a rotation that with the largest w
    assert (changed.rotations[0][:, 0] >= changed.rotations[0].abs().amax(dim=1) - 1e-6).all()
    # the scene is turned and scaled as a whole
    ratio = torch.pdist(changed.positions[0][:50]) / torch.pdist(sample.positions[0][:50])
    assert ratio.std() < 1e-4 * ratio.mean()
    assert not torch.equal(augmented(sample, np.random.default_rng(3)).positions, changed.positions)


def test_batches_are_their_gofs_side_by_side():
    one = sample_of(small_gof())
    other = replace(one, positions=one.positions + 1)
    batch = joined([one, other])
    count = one.positions.shape[1]
    assert batch.num_groups == 2
    assert torch.equal(batch.neighbours[len(one.control) :], one.neighbours + count)
    assert torch.equal(batch.positions[:, batch.control[-1]], other.positions[:, other.control[-1]])


def test_the_product_of_quaternions_is_hamiltons():
    i, j, k = torch.eye(4)[1:]
    assert torch.equal(product(i, j), k)
    assert torch.equal(product(j, i), -k)
