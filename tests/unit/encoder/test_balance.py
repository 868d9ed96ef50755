from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.balance import Quantised, balanced_octaves, bits_per_octave, no_worse, total_error
from dfcgs_codec.encoder.encoder import plan_sequence
from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.rate_control import Bound, plan_quantisation
from dfcgs_codec.encoder.sensitivity import ImageError, image_errors
from dfcgs_codec.encoder.targets import Targets
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import MemorySource
from tests.helpers import FIELDS, make_cloud

COUNT = 1500


def ball(alpha: float = 0.7, ratio: float = 3.0, count: int = COUNT) -> GaussianCloud:
    """Gaussians all over a ball: discs of that ratio of axes and opacity, in all colours."""
    rng = np.random.default_rng(2)
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


def octaves(cloud: GaussianCloud, **changes: frozenset[Attribute]) -> dict[Attribute, float]:
    fixed = changes.get("fixed", frozenset())
    drawn = quantised(cloud)
    return balanced_octaves(image_errors(cloud, np.ones(cloud.num_gaussians), drawn.draw), drawn, fixed)


def test_errors_grow_with_the_square_of_steps() -> None:
    cloud = ball()
    light = np.ones(COUNT)
    small = image_errors(cloud, light, quantised(cloud, 0.125).draw)
    large = image_errors(cloud, light, quantised(cloud, 0.25).draw)
    assert small.keys() == {a for a in Attribute if a <= Attribute.SH_1}
    for attribute in small:
        assert 3.0 < large[attribute].smooth / small[attribute].smooth < 5.0, attribute
        assert (small[attribute].swaps > 0.0) == (attribute == Attribute.POSITION)


def test_swaps_grow_with_steps() -> None:
    cloud = ball(alpha=0.9, count=6000)
    swaps = [
        image_errors(cloud, np.ones(6000), quantised(cloud, 2.0**-octave).draw)[Attribute.POSITION].swaps
        for octave in range(2, 7)
    ]
    assert 2.0**4 / 2.0 < swaps[0] / swaps[-1] < 2.0**4 * 2.0


def test_a_few_who_swap_places_are_no_accident() -> None:
    # with fine steps hardly anybody does in what is looked at: where nobody happened to, errors were 64 times
    # smaller with steps of a quarter
    cloud = ball(alpha=0.9, count=6000)
    errors = [
        image_errors(cloud, np.ones(6000), quantised(cloud, 4.0**-octave).draw)[Attribute.POSITION].at(0.0)
        for octave in range(4)
    ]
    for coarse, fine in pairwise(errors):
        assert 2.0 < coarse / fine < 17.0


def test_what_cannot_be_seen_gets_coarser_steps() -> None:
    # turns of balls show nothing, those of needles do
    assert octaves(ball(ratio=1.0))[Attribute.ROTATION] == pytest.approx(1.2)
    assert octaves(ball(ratio=20.0))[Attribute.ROTATION] < octaves(ball(ratio=2.0))[Attribute.ROTATION]
    # one logit more or less of an opaque Gaussian is nothing
    assert octaves(ball(alpha=0.999))[Attribute.OPACITY] > octaves(ball(alpha=0.5))[Attribute.OPACITY]


def test_the_sum_of_errors_stays() -> None:
    cloud = ball(ratio=5.0)
    before, light = quantised(cloud), np.ones(COUNT)
    found = octaves(cloud)
    assert max(map(abs, found.values())) < 1.2, "limits hide what is tested"
    steps = {a: step * 2.0 ** found[a] for a, step in before.steps.items()}
    old = image_errors(cloud, light, before.draw)
    new = image_errors(cloud, light, replace(before, steps=steps).draw)
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
    assert image_errors(unseen, np.zeros(100), quantised(unseen).draw) == {}
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
    errors = image_errors(room, np.ones(2 * COUNT), drawn.draw)
    alone = image_errors(cloud, np.ones(COUNT), quantised(cloud).draw)
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
    return plan_sequence(MemorySource(clouds), EncoderOptions(**options))  # type: ignore[arg-type]


def test_the_first_frame_decides_for_the_sequence() -> None:
    cloud = ball(alpha=0.98)
    still, moving = plan_of([cloud]), plan_of([cloud, cloud])
    plain = plan_of([cloud, cloud], balance=False)
    assert still.quantisation.graded_steps == moving.quantisation.graded_steps
    assert still.steps == plain.steps, "a single frame has no P-frames to plan for"
    assert moving.steps != plain.steps
    assert moving.quantisation.graded_steps != plain.quantisation.graded_steps
    assert plain.first_light is None


def test_bounds_and_uniform_steps_are_kept() -> None:
    cloud = ball()
    bounds = (Bound("alpha", 0.01), Bound("position", 0.002))
    bounded, plain = plan_of([cloud] * 2, bounds=bounds), plan_of([cloud] * 2, bounds=bounds, balance=False)
    for attribute in (Attribute.OPACITY, Attribute.POSITION):
        assert bounded.steps[attribute] == plain.steps[attribute]
        assert bounded.quantisation.graded_steps[attribute] == plain.quantisation.graded_steps[attribute]
    uniform = plan_of([cloud] * 2, visibility=False)
    assert uniform.steps == plan_of([cloud] * 2, visibility=False, balance=False).steps


def test_an_opaque_scene_gets_smaller(tmp_path: Path) -> None:
    sizes = {}
    for balance in (True, False):
        path = tmp_path / f"{balance}.dgs"
        encode_sequence([ball(alpha=0.995)], path, EncoderOptions(qp=24, balance=balance))
        sizes[balance] = path.stat().st_size
        assert ("/nobalance" in probe(path).encoder_info) is not balance
    assert sizes[True] < sizes[False]


def moved(cloud: GaussianCloud, seed: int, position: float, colour: float) -> GaussianCloud:
    """With that much noise on every position and colour."""
    rng = np.random.default_rng(seed)

    def noise(values: np.ndarray, size: float) -> np.ndarray:
        return values + rng.normal(0, size, values.shape).astype(np.float32)

    return replace(cloud, positions=noise(cloud.positions, position), sh_dc=noise(cloud.sh_dc, colour))


def errors_by_frame(frames: list[GaussianCloud], decoded: list[GaussianCloud]) -> np.ndarray:
    """RMS (frames, 2) of positions and colours; a decoded Gaussian belongs to the nearest of the input."""
    found = []
    for frame, cloud in zip(frames, decoded, strict=True):
        distance, nearest = cKDTree(frame.positions).query(cloud.positions)
        colour = frame.sh_dc[nearest] - cloud.sh_dc
        found.append([np.sqrt(np.mean(distance**2)), np.sqrt(np.mean(colour**2))])
    return np.array(found)


@pytest.mark.parametrize(("case", "column"), [("trembles", 0), ("drifts", 1)])
def test_steady_p_frames_are_nearer_to_the_input(case: str, column: int, tmp_path: Path) -> None:
    frames = [ball()]
    for seed in range(1, 7):
        noise = (seed, 0.004, 0.02) if case == "trembles" else (seed, 0.0, 0.03)
        frames.append(moved(frames[0] if case == "trembles" else frames[-1], *noise))
    assert plan_of(frames, steady=True).quantisation.graded_steps == plan_of(frames).quantisation.graded_steps
    rms, sizes = {}, {}
    for steady in (False, True):
        path = tmp_path / f"{steady}.dgs"
        encode_sequence(frames, path, EncoderOptions(steady=steady))
        rms[steady] = errors_by_frame(frames, [frame.cloud() for frame in decode_sequence(path)])[:, column]
        sizes[steady] = path.stat().st_size
        assert ("/steady" in probe(path).encoder_info) is steady
    assert rms[True][0] == rms[False][0], "the I-frame is the same"
    assert rms[True][1:].mean() < 0.9 * rms[False][1:].mean(), rms
    assert sizes[True] > sizes[False]
