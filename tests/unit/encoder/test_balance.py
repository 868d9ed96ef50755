from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import encode_sequence, probe
from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.frame.targets import Targets
from dfcgs_codec.encoder.images.balance import (
    Quantised,
    balanced_octaves,
    bits_per_octave,
    no_worse,
    total_error,
)
from dfcgs_codec.encoder.images.patches import patches_nearby
from dfcgs_codec.encoder.images.sensitivity import ImageError, image_errors
from dfcgs_codec.encoder.images.splats import Splats
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.encoder.plan.quantiser_steps import Bound, plan_quantisation
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import MemorySource
from lab.options import encoder_options
from lab.small_clouds import FIELDS, make_cloud

COUNT = 1500


def ball(alpha: float = 0.7, ratio: float = 3.0, count: int = COUNT, seed: int = 2) -> GaussianCloud:
    """Gaussians all over a ball: discs of that ratio of axes and opacity, in all colours."""
    rng = np.random.default_rng(seed)
    cloud = make_cloud(count, sh_degree=1)
    points = rng.normal(size=(count, 3))
    points *= (rng.random(count) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    scales = np.full((count, 3), np.log(0.05), np.float32)
    scales[:, 2] -= np.log(ratio)
    return replace(
        cloud,
        positions=points.astype(np.float32),
        scales=scales,
        rotations=rng.normal(size=(count, 4)).astype(np.float32),
        opacities=np.full_like(cloud.opacities, np.log(alpha / (1 - alpha))),
        sh_dc=rng.normal(0, 0.8, (count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.1, (count, 3, 3)).astype(np.float32),
    )


def quantised(cloud: GaussianCloud, coarser: float = 1.0) -> Quantised:
    plan = plan_quantisation(24, (), cloud)
    steps = {
        a: np.full((cloud.num_gaussians, 1), coarser * step)
        for a, step in plan.steps.items()
        if a <= Attribute.SH_1
    }
    return Quantised(Targets(plan.units).planes(cloud), steps, plan.units, 0.6)


def errors_of(cloud: GaussianCloud, drawn: Quantised) -> dict[Attribute, ImageError]:
    return image_errors(patches_nearby(Splats.of(cloud)), drawn.draw)


def octaves(cloud: GaussianCloud, **changes: frozenset[Attribute]) -> dict[Attribute, float]:
    fixed = changes.get("fixed", frozenset())
    drawn = quantised(cloud)
    return balanced_octaves(errors_of(cloud, drawn), drawn, fixed)


def test_errors_grow_with_the_square_of_steps() -> None:
    cloud = ball()
    small = errors_of(cloud, quantised(cloud, 0.125))
    large = errors_of(cloud, quantised(cloud, 0.25))
    assert small.keys() == {a for a in Attribute if a <= Attribute.SH_1}
    for attribute in small:
        assert 3.0 < large[attribute].smooth / small[attribute].smooth < 5.0, attribute
        assert (small[attribute].swaps > 0.0) == (attribute == Attribute.POSITION)


def error_of_positions(cloud: GaussianCloud, coarser: float) -> ImageError:
    drawn = quantised(cloud, coarser)

    def draw(rows: Int64) -> tuple[Splats, dict[Attribute, Splats]]:
        splats, changed = drawn.draw(rows)
        return splats, {Attribute.POSITION: changed[Attribute.POSITION]}

    return image_errors(patches_nearby(Splats.of(cloud)), draw)[Attribute.POSITION]


def errors_of_positions(coarser: list[float]) -> list[ImageError]:
    """Means over some balls of opaque Gaussians: a pair that lies as near as can be swaps at any step."""
    found = []
    for step in coarser:
        total = ImageError(0.0)
        for seed in range(4):
            cloud = ball(alpha=0.9, count=6000, seed=seed)
            total += error_of_positions(cloud, step).scaled(1 / 4)
        found.append(total)
    return found


def test_swaps_grow_with_steps() -> None:
    coarse, fine = errors_of_positions([1.0, 2.0**-4])
    assert 2.0**4 / 2.0 < coarse.swaps / fine.swaps < 2.0**4 * 2.0


def test_a_few_who_swap_places_are_no_accident() -> None:
    # with fine steps hardly anybody does in what is looked at: where nobody happened to, errors were 64 times
    # smaller with steps of a quarter
    for coarse, fine in pairwise(errors_of_positions([4.0**-octave for octave in range(4)])):
        assert 2.0 < coarse.at(0.0) / fine.at(0.0) < 17.0


def test_what_cannot_be_seen_gets_coarser_steps() -> None:
    # turns of balls show nothing, those of needles do
    assert octaves(ball(ratio=1.0))[Attribute.ROTATION] == pytest.approx(1.2)
    assert octaves(ball(ratio=20.0))[Attribute.ROTATION] < octaves(ball(ratio=2.0))[Attribute.ROTATION]
    # one logit more or less of an opaque Gaussian is nothing
    assert octaves(ball(alpha=0.999))[Attribute.OPACITY] > octaves(ball(alpha=0.5))[Attribute.OPACITY]


def test_the_sum_of_errors_stays() -> None:
    cloud = ball(ratio=5.0)
    before = quantised(cloud)
    found = octaves(cloud)
    assert max(map(abs, found.values())) < 1.2, "limits hide what is tested"
    steps = {a: step * 2.0 ** found[a] for a, step in before.steps.items()}
    old = errors_of(cloud, before)
    new = errors_of(cloud, replace(before, steps=steps))
    assert total_error(new, {}) == pytest.approx(total_error(old, {}), rel=0.35)


def test_fixed_attributes_are_left_alone() -> None:
    found = octaves(ball(), fixed=frozenset({Attribute.OPACITY, Attribute.SH_1}))
    assert found.keys() == {a for a in Attribute if a < Attribute.SH_1} - {Attribute.OPACITY}


def test_bits_of_an_octave() -> None:
    assert bits_per_octave(np.array([20.0]), 0.5) == pytest.approx(1.0, abs=0.02)
    assert bits_per_octave(np.array([1e-6]), 0.5) < 0.05
    sizes = np.geomspace(0.05, 5, 20)
    slopes = [bits_per_octave(np.array([size]), 0.6) for size in sizes]
    assert all(after > before - 0.02 for before, after in pairwise(slopes))


def test_scenes_without_a_size_have_no_balance() -> None:
    nowhere = replace(ball(count=40), positions=np.zeros((40, 3), np.float32))
    assert octaves(nowhere) == {}
    assert octaves(make_cloud(1)) == {}
    unseen = ball(count=100)
    assert image_errors([], quantised(unseen).draw) == {}
    assert errors_of(ball(alpha=1e-9, count=100), quantised(unseen)) == {}
    assert balanced_octaves({}, quantised(unseen), frozenset()) == {}


def in_a_room(cloud: GaussianCloud, num_walls: int) -> GaussianCloud:
    """The same in a box six times as wide whose grey walls are big flat Gaussians."""
    walls = ball(alpha=0.95, ratio=20.0, count=num_walls)
    rng = np.random.default_rng(3)
    positions = rng.uniform(-6, 6, (num_walls, 3)).astype(np.float32)
    which = np.arange(num_walls)
    axis = which % 3
    positions[which, axis] = np.where(which % 2, 6, -6)
    # the thin third axis is turned to stand on the wall
    turns = np.array([[1, 0, 1, 0], [1, -1, 0, 0], [1, 0, 0, 0]], np.float32)[axis]
    walls = replace(
        walls,
        positions=positions,
        rotations=turns,
        scales=walls.scales + np.float32(np.log(12)),
        sh_dc=np.zeros_like(walls.sh_dc),
        sh_rest=np.zeros_like(walls.sh_rest),
    )
    return replace(cloud, **{n: np.concatenate([getattr(cloud, n), getattr(walls, n)]) for n in FIELDS})


def test_a_room_does_not_drown_what_stands_in_it() -> None:
    cloud = ball()
    room = in_a_room(cloud, COUNT)
    # steps follow the typical size, so the same steps are asked about
    steps = quantised(cloud).steps
    drawn = quantised(room)
    drawn = replace(drawn, steps={a: np.full((2 * COUNT, 1), steps[a][0, 0]) for a in steps})
    errors = errors_of(room, drawn)
    alone = errors_of(cloud, quantised(cloud))
    # half of the Gaussians are the ball's, though the walls are a hundred times as large: grey walls show no
    # error of colours, so what shows is the ball's, in half of the images
    assert 0.25 < errors[Attribute.SH_1].smooth / alone[Attribute.SH_1].smooth < 0.75
    assert errors[Attribute.OPACITY].smooth > 0.1 * alone[Attribute.OPACITY].smooth


def test_a_bit_buys_the_same_in_each_attribute() -> None:
    drawn = quantised(ball(count=200))
    opacity, colour = ImageError(1.0), ImageError(4.0)
    for swaps in (0.0, 0.5, 10.0):
        errors = {
            Attribute.POSITION: ImageError(3.0, swaps),
            Attribute.OPACITY: opacity,
            Attribute.SH_DC: colour,
        }
        found = balanced_octaves(errors, drawn, frozenset())
        assert max(map(abs, found.values())) < 1.2, "limits hide what is tested"
        assert total_error(errors, found) == pytest.approx(total_error(errors, {}), rel=1e-6)
        slopes = [
            (error.at(found[a] + 1e-4) - error.at(found[a] - 1e-4)) / columns
            for (a, error), columns in zip(errors.items(), (3, 1, 3), strict=True)
        ]
        assert slopes == pytest.approx([slopes[0]] * 3, rel=1e-4)


def test_errors_are_kept_below_a_limit() -> None:
    errors = {Attribute.POSITION: ImageError(0.5, 0.5), Attribute.OPACITY: ImageError(3.0)}
    octaves = {Attribute.POSITION: 0.5, Attribute.OPACITY: 0.0}
    assert no_worse(octaves, errors, 5.0) == octaves
    less = no_worse(octaves, errors, 2.0)
    assert total_error(errors, less) == pytest.approx(2.0)
    # 0.5 x 4^o + 0.5 x 2^o + 3 x 4^p, written out once
    o, p = less[Attribute.POSITION], less[Attribute.OPACITY]
    assert 0.5 * 4**o + 0.5 * 2**o + 3 * 4**p == pytest.approx(2.0)
    assert less[Attribute.POSITION] - less[Attribute.OPACITY] == pytest.approx(0.5)
    assert no_worse({}, {}, 0.0) == {}
    assert no_worse(octaves, errors, 0.0) == octaves


def plan_of(clouds: list[GaussianCloud], **options: object) -> SequencePlan:
    return plan_sequence(MemorySource(clouds), encoder_options(**options))  # type: ignore[arg-type]


def test_the_first_frame_decides_for_the_sequence() -> None:
    cloud = ball(alpha=0.98)
    still, moving = plan_of([cloud], qp=28), plan_of([cloud, cloud], qp=28)
    plain = plan_of([cloud, cloud], qp=28, balance=False)
    assert still.quantisation.intra_steps == moving.quantisation.intra_steps
    assert still.steps == plain.steps, "a single frame has no P-frames to plan for"
    assert moving.steps != plain.steps
    assert moving.quantisation.intra_steps != plain.quantisation.intra_steps


def test_bounds_and_uniform_steps_are_kept() -> None:
    cloud = ball()
    bounds = (Bound("alpha", 0.01), Bound("position", 0.002))
    bounded, plain = (plan_of([cloud] * 2, qp=28, bounds=bounds, balance=b) for b in (True, False))
    for attribute in (Attribute.OPACITY, Attribute.POSITION):
        assert bounded.steps[attribute] == plain.steps[attribute]
        assert bounded.quantisation.intra_steps[attribute] == plain.quantisation.intra_steps[attribute]
    uniform = plan_of([cloud] * 2, qp=28, visibility=False)
    assert uniform.steps == plan_of([cloud] * 2, qp=28, visibility=False, balance=False).steps


def test_an_opaque_scene_gets_smaller(tmp_path: Path) -> None:
    sizes = {}
    for balance in (True, False):
        path = tmp_path / f"{balance}.dgs"
        encode_sequence([ball(alpha=0.995)], path, encoder_options(qp=24, balance=balance))
        sizes[balance] = path.stat().st_size
        assert ("balance=False" in probe(path).encoder_info) is not balance
    assert sizes[True] < sizes[False]
