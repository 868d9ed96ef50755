"""encode_sequence -> decode_sequence: what comes out is what the encoder had, and near what went in."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dfcgs_codec import Bound, EncoderOptions, GaussianCloud, InputError, decode_sequence, probe
from dfcgs_codec.bitstream.constants import MAX_THIN_OCTAVES, Attribute, IntraKind, OutputOrder
from dfcgs_codec.codec.state.visibility import MULTIPLIERS
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.sequence import open_folder
from lab.options import encoder_options
from lab.small_clouds import (
    FIELDS,
    all_changing,
    clustered_cloud,
    coincident_cloud,
    drifting,
    make_cloud,
    real_cloud,
    same_cloud,
    shuffled,
    still,
    travelling,
    untracked,
    with_outliers,
)
from tests.helpers import (
    QUICK,
    alphas,
    covariances,
    decode,
    encode,
    frame_hashes,
    match,
    rotation_degrees,
    round_trip,
    shape_errors,
    taking_turns,
    write_frames,
)

INPUT, SEQUENCE, FREE = OutputOrder.INPUT, OutputOrder.SEQUENCE, OutputOrder.FREE
#: index by index comparable with the input
PLAIN = encoder_options(QUICK, order=INPUT, visibility=False)

SEQUENCES: dict[str, Callable[[], list[GaussianCloud]]] = {
    "one Gaussian": lambda: drifting(make_cloud(1, 1), 4),
    "two Gaussians": lambda: all_changing(make_cloud(2, 1), 4),
    "33 Gaussians": lambda: all_changing(make_cloud(33, 1), 4),
    "1000 Gaussians": lambda: all_changing(make_cloud(1000), 3),
    "SH degree 0": lambda: drifting(make_cloud(100, 0), 4),
    "SH degree 1": lambda: drifting(make_cloud(100, 1), 4),
    "SH degree 2": lambda: all_changing(make_cloud(100, 2), 4),
    "SH degree 3": lambda: all_changing(make_cloud(100, 3), 4),
    "clusters": lambda: all_changing(clustered_cloud(300, 1), 4),
    "trained": lambda: drifting(real_cloud(200), 4),
    "coincident": lambda: all_changing(coincident_cloud(100), 3),
    "outliers": lambda: all_changing(with_outliers(make_cloud(300), 4), 4),
    "far outliers": lambda: drifting(with_outliers(make_cloud(300), 4, 1e6), 3),
    "still": lambda: still(make_cloud(100, 1), 4),
    "travelling": lambda: travelling(make_cloud(100), 6),
    "untracked": lambda: untracked(100, 4),
    "scene cut": lambda: still(make_cloud(100), 2) + drifting(make_cloud(100, 0, 5), 3),
    "lost order": lambda: [make_cloud(100), shuffled(make_cloud(100)), shuffled(make_cloud(100), 4)],
    "changed count": lambda: [*still(make_cloud(90), 2), make_cloud(91), *drifting(make_cloud(40), 3)],
    "growing": lambda: [make_cloud(1), make_cloud(2), make_cloud(33), make_cloud(100)],
}


def coarsest_steps(plan: SequencePlan) -> dict[Attribute, float]:
    """The coarsest quantiser steps in the attributes' own units."""
    units, steps = plan.header.unit_exponents, plan.quantisation.steps
    exponents = {
        Attribute.POSITION: units.position,
        Attribute.SCALE: units.scale,
        Attribute.ROTATION: -18,
        Attribute.OPACITY: units.opacity,
    }
    coarser = MULTIPLIERS[-1] / MULTIPLIERS[0] if plan.options.tuning.visibility else 1.0
    steps = {a: max(step, plan.quantisation.intra_steps[a]) for a, step in steps.items()}
    if plan.quantisation.follows_visibility:
        # a thin axis: the error of how thin it is, companded, and that of axis 1
        steps[Attribute.SCALE] *= 1 + (1 << MAX_THIN_OCTAVES)
    return {a: coarser * (step + 1) * 2.0 ** exponents.get(a, units.color) for a, step in steps.items()}


def coded(
    frames: list[GaussianCloud], path: Path, options: EncoderOptions
) -> tuple[list[GaussianCloud], dict[Attribute, float]]:
    """What is decoded of encoded frames, and the coarsest steps that the encoder planned."""
    plans = []

    def noted(*arguments: object) -> SequencePlan:
        plans.append(plan_sequence(*arguments))  # type: ignore[arg-type]
        return plans[0]

    with patch("dfcgs_codec.encoder.frame.encoder.plan_sequence", noted):
        decoded = round_trip(frames, path, options)
    return decoded, coarsest_steps(plans[0])


def check_close(
    source: GaussianCloud, decoded: GaussianCloud, steps: dict[Attribute, float], dead_zone: float = 0.6
) -> None:
    """Equal indices lie within the dead zone of each other, whatever the axes are called.

    Two quantisers that take turns may be farther off.
    """
    dead_zone = max(dead_zone, 0.85)
    float32 = np.abs(source.positions) * 2.0**-23
    assert (
        np.abs(source.positions - decoded.positions) <= dead_zone * steps[Attribute.POSITION] + float32
    ).all()
    degrees, scales = shape_errors(source, decoded)
    assert scales.max() <= dead_zone * steps[Attribute.SCALE] + 1e-5
    assert degrees.max() <= np.degrees(4 * np.sqrt(3) * dead_zone * steps[Attribute.ROTATION]) + 1e-3
    alpha = np.abs(alphas(source) - alphas(decoded))
    # opacities make up for the errors of scales, by up to a logit
    assert alpha.max() <= 0.262 * dead_zone * steps[Attribute.OPACITY] + 0.25
    assert np.abs(source.sh_dc - decoded.sh_dc).max() <= dead_zone * steps[Attribute.SH_DC] + 1e-6
    if source.sh_degree:
        coarsest = max(step for a, step in steps.items() if a >= Attribute.SH_1)
        assert np.abs(source.sh_rest - decoded.sh_rest).max() <= dead_zone * coarsest + 1e-6


# --- every kind of sequence ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", SEQUENCES)
def test_decoder_and_encoder_agree(name: str, tmp_path: Path) -> None:
    frames = SEQUENCES[name]()
    report = encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=3))
    decoded = decode(tmp_path / "a.dgs")
    assert [frame.state.hash() for frame in decoded] == frame_hashes(tmp_path / "a.dgs")
    assert [frame.state.num_gaussians for frame in decoded] == [f.num_gaussians for f in frames]
    assert report.num_bytes == (tmp_path / "a.dgs").stat().st_size
    for frame, source in zip(decoded, frames, strict=True):
        cloud = frame.cloud()
        assert cloud.sh_degree == source.sh_degree
        assert all(np.isfinite(getattr(cloud, field)).all() for field in FIELDS)


@pytest.mark.parametrize(("name", "visibility"), taking_turns(list(SEQUENCES), (True, False)))
def test_input_order_matches_the_input_index_by_index(name: str, visibility: bool, tmp_path: Path) -> None:
    frames = SEQUENCES[name]()
    options = encoder_options(PLAIN, gof_size=2, visibility=visibility)
    decoded, steps = coded(frames, tmp_path / "a.dgs", options)
    for source, cloud in zip(frames, decoded, strict=True):
        check_close(source, cloud, steps)


@pytest.mark.parametrize("name", ["33 Gaussians", "trained", "untracked", "lost order", "changed count"])
def test_free_order_holds_the_same_gaussians(name: str, tmp_path: Path) -> None:
    frames = SEQUENCES[name]()
    decoded, steps = coded(frames, tmp_path / "a.dgs", replace(PLAIN, order=FREE))
    for source, cloud in zip(frames, decoded, strict=True):
        check_close(source.take(match(source, cloud)), cloud, steps)


# with coarser steps a rotation may be so far off that the axes cannot be told apart afterwards
@pytest.mark.parametrize("qp", [0, 10, 20, 36, 44])
def test_every_quality_keeps_its_steps(qp: float, tmp_path: Path) -> None:
    frames = all_changing(make_cloud(150, 2), 4)
    decoded, steps = coded(frames, tmp_path / "a.dgs", replace(PLAIN, qp=qp))
    for source, cloud in zip(frames, decoded, strict=True):
        check_close(source, cloud, steps)


def test_a_finer_quality_takes_more_bytes(tmp_path: Path) -> None:
    frames = drifting(make_cloud(200, 1), 2)
    sizes = [encode(frames, tmp_path / "a.dgs", EncoderOptions(qp=qp)).num_bytes for qp in (40, 30, 20, 10)]
    assert sizes == sorted(sizes)


@st.composite
def sequences(draw: st.DrawFn) -> list[GaussianCloud]:
    """Frames each made from the one before by something that happens to sequences."""
    degree = draw(st.integers(0, 2))
    frames = [make_cloud(draw(st.integers(1, 24)), degree, draw(st.integers(0, 99)))]
    changes = {
        "same": lambda cloud: cloud,
        "moved": lambda cloud: drifting(cloud, 2)[1],
        "changed": lambda cloud: all_changing(cloud, 2)[1],
        "shuffled": shuffled,
        "cut": lambda cloud: make_cloud(cloud.num_gaussians, degree, 7),
        "born": lambda cloud: make_cloud(cloud.num_gaussians + 3, degree, 8),
        "died": lambda cloud: cloud.take(np.arange(cloud.num_gaussians // 2 + 1)),
        "far": lambda cloud: with_outliers(cloud, 1, 8.0),
    }
    for name in draw(st.lists(st.sampled_from(sorted(changes)), max_size=4)):
        frames.append(changes[name](frames[-1]))
    return frames


OPTIONS = st.builds(
    encoder_options,
    qp=st.integers(4, 46),
    gof_size=st.integers(1, 5),
    intra=st.sampled_from(IntraKind),
    order=st.just(INPUT),
    zero_bin=st.sampled_from([0.5, 0.6, 1.0]),
    bounds=st.sampled_from([(), (Bound("position", 0.02),), (Bound("alpha", 0.05), Bound("sh", 0.05))]),
)


def check_whatever_happens(frames: list[GaussianCloud], options: EncoderOptions) -> None:
    with tempfile.TemporaryDirectory() as folder:
        try:
            decoded, steps = coded(frames, Path(folder) / "a.dgs", options)
        except InputError as error:
            # a scene may grow beyond what its first frame let expect
            assume("reach" not in str(error))
            raise
    for source, cloud in zip(frames, decoded, strict=True):
        check_close(source, cloud, steps, options.tuning.zero_bin)


@pytest.mark.parametrize("examples", [8, pytest.param(100, marks=pytest.mark.slow)])
def test_anything_that_happens_with_any_options(examples: int) -> None:
    settings(max_examples=examples)(given(sequences(), OPTIONS)(check_whatever_happens))()


# --- identity -----------------------------------------------------------------------------------------


def permutations(frames: list[GaussianCloud], decoded: list[GaussianCloud]) -> list[list[int]]:
    """Which input Gaussian each decoded Gaussian is, frame by frame."""
    return [match(source, cloud).tolist() for source, cloud in zip(frames, decoded, strict=True)]


@pytest.mark.parametrize(
    "frames",
    [
        drifting(make_cloud(200), 7),
        all_changing(make_cloud(200, 0, 2), 7),
        travelling(make_cloud(200), 12, 0.4),
        travelling(make_cloud(2), 8, 0.05),
    ],
    ids=["drifting", "all_changing", "travelling", "two"],
)
@pytest.mark.parametrize("gof_size", [pytest.param(1, marks=pytest.mark.slow), 3, 100])
def test_a_tracked_sequence_has_one_order_over_gof_borders(
    frames: list[GaussianCloud], gof_size: int, tmp_path: Path
) -> None:
    options = replace(QUICK, order=SEQUENCE, gof_size=gof_size)
    found = permutations(frames, round_trip(frames, tmp_path / "a.dgs", options))
    assert found == [found[0]] * len(frames)


def test_a_run_after_a_cut_has_one_order_of_its_own(tmp_path: Path) -> None:
    frames = drifting(make_cloud(200), 4) + drifting(make_cloud(150), 8)
    found = permutations(frames, round_trip(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=2)))
    assert found == [found[0]] * 4 + [found[4]] * 8


def test_axis_names_never_flip_in_a_tracked_sequence(tmp_path: Path) -> None:
    frames = all_changing(make_cloud(200), 6)
    decoded = round_trip(frames, tmp_path / "a.dgs", EncoderOptions(gof_size=2, qp=10))
    for before, after in itertools.pairwise(decoded):
        assert rotation_degrees(before, after).max() < 60
        assert np.abs(before.scales - after.scales).max() < 0.2


def test_renamed_gaussians_have_the_same_covariance(tmp_path: Path) -> None:
    frames = drifting(make_cloud(200), 2)
    options = replace(QUICK, order=INPUT, bounds=(Bound("rotation", 0.005), Bound("scale", 1e-4)))
    for source, decoded in zip(frames, round_trip(frames, tmp_path / "a.dgs", options), strict=True):
        size = np.abs(covariances(source)).max(axis=(1, 2))
        assert (np.abs(covariances(source) - covariances(decoded)).max(axis=(1, 2)) / size).max() < 1e-3


# --- what stands still --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["one Gaussian", "trained", "SH degree 3"])
@pytest.mark.parametrize("intra", IntraKind)
def test_identical_frames_cost_64_bytes_at_most(name: str, intra: IntraKind, tmp_path: Path) -> None:
    frames = still(SEQUENCES[name]()[0], 5)
    report = encode(frames, tmp_path / "a.dgs", encoder_options(QUICK, intra=intra))
    assert [frame.kind for frame in report.frames] == ["I"] + ["skip"] * 4
    assert max(frame.num_bytes for frame in report.frames[1:]) <= 64
    decoded = [frame.cloud() for frame in decode(tmp_path / "a.dgs")]
    assert all(same_cloud(cloud, decoded[0]) for cloud in decoded)


@pytest.mark.parametrize("options", [PLAIN, QUICK])
def test_static_gaussians_are_bit_identical(options: EncoderOptions, tmp_path: Path) -> None:
    cloud = make_cloud(300, 1)
    frames = drifting(cloud, 15)
    decoded = round_trip(frames, tmp_path / "a.dgs", replace(options, gof_size=100))
    still_rows = match(cloud, decoded[0])
    still_rows = np.flatnonzero(cloud.positions[still_rows, 0] <= 0)
    for frame in decoded[1:]:
        assert same_cloud(frame.take(still_rows), decoded[0].take(still_rows))
        # what moves may be turned along
        for field in ("scales", "opacities", "sh_dc", "sh_rest"):
            assert getattr(frame, field).tobytes() == getattr(decoded[0], field).tobytes()


def test_bounded_attributes_are_bit_identical_over_gof_borders(tmp_path: Path) -> None:
    """They are multiples of their steps, whatever neighbours a Gaussian has."""
    bounds = {"scale": 0.02, "alpha": 0.02, "colour": 0.01, "sh": 0.02}
    options = replace(QUICK, gof_size=3, bounds=bounds)
    decoded = round_trip(drifting(make_cloud(200, 1), 9), tmp_path / "a.dgs", options)
    for frame in decoded[1:]:
        for field in ("scales", "opacities", "sh_dc", "sh_rest"):
            assert getattr(frame, field).tobytes() == getattr(decoded[0], field).tobytes()


def test_identical_frames_decode_identically_over_gof_borders(tmp_path: Path) -> None:
    for order in (SEQUENCE, INPUT):
        options = replace(QUICK, gof_size=2, order=order)
        decoded = round_trip(still(make_cloud(120, 2), 5), tmp_path / "a.dgs", options)
        assert all(same_cloud(frame, decoded[0]) for frame in decoded)


# --- bounds -------------------------------------------------------------------------------------------


def measured(source: GaussianCloud, decoded: GaussianCloud) -> dict[str, float]:
    """Errors of the decoded float32 values in float64, in the units of --bound."""
    degrees, scales = shape_errors(source, decoded)
    wide = {f: getattr(source, f).astype(np.float64) - getattr(decoded, f) for f in FIELDS}
    return {
        "position": float(np.linalg.norm(wide["positions"], axis=1).max()),
        "rotation": float(degrees.max()),
        "scale": float(scales.max()),
        "alpha": float(np.abs(alphas(source) - alphas(decoded)).max()),
        "colour": float(np.abs(wide["sh_dc"]).max() * 0.28209479177387814),
        "sh": float(np.abs(wide["sh_rest"]).max(initial=0)),
    }


BOUNDS = [
    *[("position", value) for value in (0.1, 1e-3, 1e-5)],
    *[("rotation", value) for value in (5.0, 0.1, 0.005)],
    *[("scale", value) for value in (0.5, 1e-2, 1e-5)],
    *[("alpha", value) for value in (0.1, 1e-2, 1e-4)],
    *[("colour", value) for value in (0.1, 1e-3, 1e-5)],
    *[("sh", value) for value in (0.1, 1e-3, 1e-5)],
]


def check_bounds(bounds: dict[str, float], intra: IntraKind, path: Path) -> None:
    frames = all_changing(make_cloud(200, 1), 4, seed=11) + drifting(make_cloud(60, 1), 2)
    options = encoder_options(QUICK, order=INPUT, bounds=bounds, intra=intra, gof_size=3)
    decoded = round_trip(frames, path, options)
    errors = [measured(source, cloud) for source, cloud in zip(frames, decoded, strict=True)]
    for name, value in bounds.items():
        found = max(error[name] for error in errors)
        assert found <= value
        if intra == IntraKind.CODED:
            # a bound is a budget: a step much smaller than allowed wastes bits
            assert found >= value / 4


@pytest.mark.parametrize("level", [0, 1, 2], ids=["wide", "medium", "narrow"])
@pytest.mark.parametrize("intra", IntraKind)
def test_bounds_hold_on_the_decoded_values(level: int, intra: IntraKind, tmp_path: Path) -> None:
    check_bounds(dict(BOUNDS[level::3]), intra, tmp_path / "a.dgs")


@pytest.mark.parametrize(("name", "value"), BOUNDS[1::3])
def test_a_bound_holds_alone(name: str, value: float, tmp_path: Path) -> None:
    check_bounds({name: value}, IntraKind.CODED, tmp_path / "a.dgs")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), BOUNDS)
@pytest.mark.parametrize("intra", IntraKind)
def test_each_bound_holds_alone(name: str, value: float, intra: IntraKind, tmp_path: Path) -> None:
    check_bounds({name: value}, intra, tmp_path / "a.dgs")


def test_all_bounds_at_once(tmp_path: Path) -> None:
    bounds = {"position": 0.002, "rotation": 0.5, "scale": 0.01, "alpha": 0.01, "colour": 0.01, "sh": 0.02}
    frames = all_changing(clustered_cloud(300, 2), 5)
    options = replace(QUICK, order=INPUT, bounds=tuple(Bound(*item) for item in bounds.items()))
    for source, decoded in zip(frames, round_trip(frames, tmp_path / "a.dgs", options), strict=True):
        errors = measured(source, decoded)
        assert {name: errors[name] for name in bounds if errors[name] > bounds[name]} == {}


def test_the_report_says_what_is_measured(tmp_path: Path) -> None:
    frames = all_changing(make_cloud(200, 1), 4)
    report = encode(frames, tmp_path / "a.dgs", replace(QUICK, order=INPUT))
    decoded = [frame.cloud() for frame in decode(tmp_path / "a.dgs")]
    errors = [measured(*pair) for pair in zip(frames, decoded, strict=True)]
    for name, statistics in report.errors.items():
        assert statistics.maximum == pytest.approx(max(e[name] for e in errors), rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("name", ["position", "rotation"])
# three positions may happen to lie on the finest grid, and then the bound is kept
@pytest.mark.parametrize("count", [40, 300])
def test_a_bound_below_float32_is_refused_and_leaves_nothing(name: str, count: int, tmp_path: Path) -> None:
    frames = still(make_cloud(count, 1), 2)
    options = EncoderOptions(bounds=(Bound(name, 1e-12),))
    with pytest.raises(InputError):
        encode(frames, tmp_path / "a.dgs", options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["scale", "alpha", "colour", "sh"])
def test_a_bound_below_float32_is_kept_by_escapes(name: str, tmp_path: Path) -> None:
    frames = still(make_cloud(40, 1), 2)
    report = encode(frames, tmp_path / "a.dgs", replace(QUICK, bounds=(Bound(name, 1e-12),)))
    assert report.errors[name].maximum <= 1e-12
    assert report.num_escapes


# --- GoFs, processes, sources, ranges -----------------------------------------------------------------


@pytest.mark.parametrize("gof_size", [1, 2, 4, 7, 1000])
def test_gof_sizes(gof_size: int, tmp_path: Path) -> None:
    frames = drifting(make_cloud(100), 7)
    encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=gof_size))
    kinds = [frame.frame_type for frame in probe(tmp_path / "a.dgs").frames]
    assert [kind == "I" for kind in kinds] == [i % gof_size == 0 for i in range(7)]
    decode(tmp_path / "a.dgs")


NEVER_WORSE = ["two Gaussians", "33 Gaussians", "SH degree 3", "trained", "still", "travelling", "untracked"]
NEVER_WORSE += ["scene cut", "lost order", "changed count", "outliers", "coincident"]


@pytest.mark.parametrize(("name", "order"), taking_turns(NEVER_WORSE, (SEQUENCE, INPUT)))
def test_p_frames_never_cost_more_than_i_frames_would(name: str, order: OutputOrder, tmp_path: Path) -> None:
    frames = SEQUENCES[name]()
    intra = encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=1, order=order)).num_bytes
    assert encode(frames, tmp_path / "b.dgs", replace(QUICK, order=order)).num_bytes <= 1.02 * intra + 64


def test_motion_is_cheaper_with_p_frames(tmp_path: Path) -> None:
    frames = drifting(real_cloud(500), 5)
    intra = encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=1)).num_bytes
    assert encode(frames, tmp_path / "b.dgs", replace(QUICK, gof_size=5)).num_bytes < 0.4 * intra


def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    frames = all_changing(make_cloud(150, 1), 5) + drifting(make_cloud(90, 1), 4)
    for jobs in (1, 2):
        encode(frames, tmp_path / f"{jobs}.dgs", replace(QUICK, gof_size=3, jobs=jobs))
    assert (tmp_path / "1.dgs").read_bytes() == (tmp_path / "2.dgs").read_bytes()


def test_two_processes_read_a_folder(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", drifting(make_cloud(50), 5))
    for jobs in (1, 2):
        encode(folder, tmp_path / f"{jobs}.dgs", replace(QUICK, gof_size=2, jobs=jobs))
    assert (tmp_path / "1.dgs").read_bytes() == (tmp_path / "2.dgs").read_bytes()


@pytest.mark.parametrize("where", [0, 3])
def test_an_error_in_another_process_arrives_and_leaves_nothing(where: int, tmp_path: Path) -> None:
    frames = still(make_cloud(20), 6)
    folder = write_frames(tmp_path / "frames", frames)
    path = folder / f"frame_{where:04d}.ply"
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(InputError, match=path.name):
        encode(folder, tmp_path / "a.dgs", EncoderOptions(gof_size=2, jobs=2))
    assert [p.name for p in tmp_path.iterdir()] == ["frames"]


def test_memory_and_folder_are_the_same(tmp_path: Path) -> None:
    frames = all_changing(make_cloud(60, 2), 4)
    folder = write_frames(tmp_path / "frames", frames)
    encode(frames, tmp_path / "memory.dgs")
    encode(folder, tmp_path / "folder.dgs")
    assert (tmp_path / "memory.dgs").read_bytes() == (tmp_path / "folder.dgs").read_bytes()


def test_frame_numbers_with_gaps_survive(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    for number in (3, 4, 9, 20):
        write_frames(folder, [make_cloud(10)], first=number)
    encode(open_folder(folder, allow_gaps=True), tmp_path / "a.dgs", replace(QUICK, gof_size=2))
    assert [frame.number for frame in decode(tmp_path / "a.dgs")] == [3, 4, 9, 20]
    assert [frame.number for frame in decode(tmp_path / "a.dgs", 2)] == [9, 20]


@pytest.mark.parametrize("name", ["scene cut", "changed count", "trained"])
def test_ranges_are_slices(name: str, tmp_path: Path) -> None:
    frames = SEQUENCES[name]()
    encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=2))
    whole = decode(tmp_path / "a.dgs")
    for start in range(len(frames)):
        for stop in range(start + 1, len(frames) + 1):
            part = decode(tmp_path / "a.dgs", start, stop)
            assert [f.index for f in part] == list(range(start, stop))
            assert [f.state.hash() for f in part] == [f.state.hash() for f in whole[start:stop]]
            assert all(same_cloud(f.cloud(), whole[f.index].cloud()) for f in part)


def test_frames_come_one_by_one(tmp_path: Path) -> None:
    encode(drifting(make_cloud(20), 5), tmp_path / "a.dgs")
    frames = decode_sequence(tmp_path / "a.dgs")
    assert next(frames).index == 0
    assert next(frames).index == 1
    frames.close()


# --- verbatim I-frames --------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("order", [SEQUENCE, INPUT])
def test_ply_i_frames_are_lossless(degree: int, order: OutputOrder, tmp_path: Path) -> None:
    frames = [make_cloud(60, degree, seed) for seed in range(3)]
    options = encoder_options(intra=IntraKind.PLY, order=order, gof_size=1)
    for source, decoded in zip(frames, round_trip(frames, tmp_path / "a.dgs", options), strict=True):
        index = np.arange(60) if order == INPUT else match(source, decoded)
        assert same_cloud(decoded, source.take(index))


def test_ply_i_frames_keep_signed_zeros_and_denormals(tmp_path: Path) -> None:
    cloud = make_cloud(4, 1)
    special = np.array([-0.0, 1e-45, -1.1e-38, 3e4], np.float32)
    cloud = replace(
        cloud, opacities=special, sh_rest=np.broadcast_to(special[:, None, None], (4, 3, 3)).copy()
    )
    options = encoder_options(intra=IntraKind.PLY, order=INPUT)
    assert same_cloud(round_trip([cloud], tmp_path / "a.dgs", options)[0], cloud)


def test_p_frames_after_a_ply_i_frame_stay_close(tmp_path: Path) -> None:
    frames = all_changing(make_cloud(100, 1), 4)
    options = encoder_options(PLAIN, intra=IntraKind.PLY)
    decoded, steps = coded(frames, tmp_path / "a.dgs", options)
    assert same_cloud(decoded[0], frames[0])
    for source, cloud in zip(frames, decoded, strict=True):
        check_close(source, cloud, steps)


# --- input that has a defined answer ------------------------------------------------------------------


def broken(field: str, value: float) -> GaussianCloud:
    cloud = make_cloud(20, 1)
    values = getattr(cloud, field).copy()
    values[3] = value
    return replace(cloud, **{field: values})


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("where", [0, 1])
def test_values_that_are_not_finite_are_refused(field: str, value: float, where: int, tmp_path: Path) -> None:
    frames = still(make_cloud(20, 1), 2)
    frames[where] = broken(field, value)
    with pytest.raises(InputError, match=r"NaN|inf|finite"):
        encode(frames, tmp_path / "a.dgs")
    assert list(tmp_path.iterdir()) == []


def test_zero_quaternions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="quaternion"):
        encode([broken("rotations", 0.0)], tmp_path / "a.dgs")


@pytest.mark.parametrize("where", [(0,), (1,), (2,), (0, 1), (1, 2), (0, 1, 2)])
@pytest.mark.parametrize(("gof_size", "order"), [(None, SEQUENCE), (None, INPUT), (1, SEQUENCE)])
def test_frames_without_gaussians_are_frames(
    where: tuple[int, ...], gof_size: int | None, order: OutputOrder, tmp_path: Path
) -> None:
    frames = still(make_cloud(20), 3)
    for index in where:
        frames[index] = make_cloud(0)
    encode(frames, tmp_path / "a.dgs", replace(QUICK, gof_size=gof_size, order=order))
    decoded = [frame.cloud() for frame in decode(tmp_path / "a.dgs")]
    assert [cloud.num_gaussians for cloud in decoded] == [cloud.num_gaussians for cloud in frames]


@pytest.mark.parametrize("degrees", [(0, 1), (2, 0)])
def test_missing_sh_coefficients_are_zero(degrees: tuple[int, int], tmp_path: Path) -> None:
    frames = [make_cloud(20, degree) for degree in degrees]
    report = encode(frames, tmp_path / "a.dgs", replace(QUICK, order=INPUT))
    assert "SH degree" in report.notes[0]
    for frame in decode(tmp_path / "a.dgs"):
        assert frame.cloud().sh_degree == max(degrees)
    assert report.errors["sh"].maximum < 0.5


def test_what_is_not_a_cloud_is_refused(tmp_path: Path) -> None:
    with pytest.raises((InputError, TypeError)):
        encode([make_cloud(5), "frame_0001.ply", make_cloud(5)], tmp_path / "a.dgs")


EXTREMES = {
    "at the origin": replace(make_cloud(3), positions=np.zeros((3, 3), np.float32)),
    "tiny": replace(
        make_cloud(1), positions=np.zeros((1, 3), np.float32), scales=np.full((1, 3), -50, np.float32)
    ),
    "huge": replace(make_cloud(40), scales=np.full((40, 3), 80, np.float32)),
    "beyond the universe": with_outliers(make_cloud(40), 1, 1e30),
    "one huge scale": broken("scales", 1e6),
    "opaque": replace(make_cloud(40), opacities=np.full(40, 1e30, np.float32)),
    "bright": replace(make_cloud(40), sh_dc=np.full((40, 3), -3e38, np.float32)),
    "round": replace(make_cloud(40), scales=np.full((40, 3), -4, np.float32)),
    "long quaternions": replace(make_cloud(40), rotations=make_cloud(40).rotations * np.float32(1e30)),
    "short quaternions": replace(make_cloud(40), rotations=make_cloud(40).rotations * np.float32(1e-30)),
}


def check_coded_or_refused(frames: list[GaussianCloud], path: Path, options: EncoderOptions) -> None:
    """Whatever the encoder accepts, the decoder reads, and nothing is clipped."""
    try:
        decoded, steps = coded(frames, path, options)
    except InputError:
        assert list(path.parent.iterdir()) == []
        return
    check_close(frames[-1], decoded[-1], steps)


@pytest.mark.parametrize("name", EXTREMES)
@pytest.mark.parametrize("intra", IntraKind)
def test_extremes_are_coded_or_refused(name: str, intra: IntraKind, tmp_path: Path) -> None:
    check_coded_or_refused(still(EXTREMES[name], 2), tmp_path / "a.dgs", encoder_options(PLAIN, intra=intra))


@pytest.mark.parametrize("factor", [1e2, 1e4, 1e8, 1e20])
def test_a_scene_that_grows_is_coded_or_refused_and_never_clipped(factor: float, tmp_path: Path) -> None:
    frames = [make_cloud(100), with_outliers(make_cloud(100), 1, factor)]
    check_coded_or_refused(frames, tmp_path / "a.dgs", PLAIN)
