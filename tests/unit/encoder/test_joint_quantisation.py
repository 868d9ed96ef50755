from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.encoder.frame.targets import Targets
from dfcgs_codec.encoder.images.joint_quantisation import opacities_beside
from dfcgs_codec.encoder.images.splats import alpha_of
from dfcgs_codec.encoder.intra.intra_plan import IntraPlan
from dfcgs_codec.encoder.plan.quantiser_steps import Bound, plan_quantisation
from dfcgs_codec.transform.companding import compress, expand
from lab.small_clouds import real_cloud

UNITS = UnitExponents(-14, -14, -14, -14)
SCALES = np.rint(np.log([[0.3, 0.2, 0.01]]) * 2**14).astype(np.int64)


def planes(logits: np.ndarray) -> dict[Attribute, np.ndarray]:
    opacity = compress(np.rint(logits * 2**14).astype(np.int64), -14)[:, None]
    return {Attribute.SCALE: np.repeat(SCALES, len(logits), axis=0), Attribute.OPACITY: opacity}


def alpha(opacities: np.ndarray) -> np.ndarray:
    return alpha_of(expand(opacities[:, 0], -14) / 2**14)


def image(opacity: float, log_scales: np.ndarray) -> np.ndarray:
    """Seen along the short axis."""
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 61), np.linspace(-1.5, 1.5, 61))
    a, b = np.exp(log_scales[:2] / 2**14)
    return opacity * np.exp(-(x**2) / (2 * a * a) - y**2 / (2 * b * b))


def test_what_is_right_stays_as_it_is() -> None:
    given = planes(np.linspace(-30, 30, 200))
    assert np.array_equal(opacities_beside(given[Attribute.SCALE], given, UNITS), given[Attribute.OPACITY])


@pytest.mark.parametrize("logit", [-4.0, 0.0, 2.0])
@pytest.mark.parametrize("error", [[0.1, 0.1, 0.0], [-0.1, 0.02, 0.3], [0.15, -0.05, 0.0]])
def test_the_image_is_nearer(logit: float, error: list[float]) -> None:
    given = planes(np.array([logit]))
    decoded = SCALES + np.rint(np.array([error]) * 2**14).astype(np.int64)
    source = image(alpha(given[Attribute.OPACITY])[0], SCALES[0])
    left = image(alpha(given[Attribute.OPACITY])[0], decoded[0]) - source
    beside = image(alpha(opacities_beside(decoded, given, UNITS))[0], decoded[0]) - source
    assert (beside**2).sum() < 0.85 * (left**2).sum()


def test_what_is_opaque_hardly_changes() -> None:
    given = planes(np.array([6.0, 9.0, 20.0, -20.0]))
    decoded = given[Attribute.SCALE] + 9000
    change = alpha(opacities_beside(decoded, given, UNITS)) - alpha(given[Attribute.OPACITY])
    assert np.abs(change).max() < 0.005


def test_bounded_opacities_are_left_alone() -> None:
    cloud = real_cloud(300)
    for bounds in ((), (Bound("alpha", 0.05),)):
        quantisation = plan_quantisation(28, bounds, cloud)
        found = Targets(quantisation.units).planes(cloud)
        plan = IntraPlan.of(found, None, quantisation)
        ordered = np.arange(300), plan.order(found[Attribute.POSITION])[1]
        target = plan.target(found, ordered, quantisation, 0.5)
        larger = {Attribute.SCALE: found[Attribute.SCALE] + 500}
        goal = target.column(Attribute.OPACITY, 0, larger, [])
        same = np.array_equal(goal.values, found[Attribute.OPACITY][:, 0])
        assert same == bool(bounds)
