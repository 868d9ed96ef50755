from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import MAX_COARSE_LOG2, MAX_THIN_OCTAVES, STATE_LIMIT, Attribute
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.intra.verbatim import state_of
from dfcgs_codec.codec.intra.walk import MAX_COVER, IntraShape, code_intra
from dfcgs_codec.codec.state.planes import FrameState
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraPlan, IntraTarget, steps_in_intra_frame
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.encoder.plan.quantiser_steps import Bound, plan_quantisation
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.companding import thin_octaves
from lab.small_clouds import clustered_cloud, make_cloud, real_cloud


def task(
    cloud: GaussianCloud,
    coarse_log2: int | None = None,
    cover: np.ndarray | None = None,
    *,
    alternating: bool = True,
) -> tuple[IntraTarget, IntraShape]:
    """A cloud at medium quality, classes drawn at random."""
    quantisation = plan_quantisation(28, (), cloud)
    planes = {a: p.wide() for a, p in state_of(cloud, quantisation.units).planes.items()}
    planes = choose_axis_names(planes).rename(planes)
    count = cloud.num_gaussians
    if cover is None:
        cover = np.random.default_rng(7).uniform(0, 5, count)
    plan = IntraPlan.of(planes, np.rint(cover).astype(np.int64), quantisation)
    if coarse_log2 is not None:
        plan = replace(plan, steps=replace(plan.steps, coarse_log2=coarse_log2))
    if not alternating:
        plan = replace(plan, steps=replace(plan.steps, alternating=frozenset()))
    order, grid = plan.order(planes[Attribute.POSITION])
    target = plan.target({a: v[order] for a, v in planes.items()}, (order, grid), quantisation, 0.5)
    return target, IntraShape(count, False, grid, plan.steps, quantisation.units)


def write(target: IntraTarget, shape: IntraShape) -> tuple[list[bytes], FrameState]:
    writers: list[SymbolWriter] = []

    def open_writer() -> SymbolWriter:
        writers.append(SymbolWriter())
        return writers[-1]

    state = code_intra(open_writer, target, shape)
    return [writer.getvalue() for writer in writers], state


def read(streams: list[bytes], shape: IntraShape) -> FrameState:
    readers = [SymbolReader(stream) for stream in streams]
    rest = iter(readers)
    state = code_intra(lambda: next(rest), None, shape)
    for reader in readers:
        reader.finish()
    return state


@pytest.mark.parametrize("coarse_log2", [0, 1, 3, MAX_COARSE_LOG2])
@pytest.mark.parametrize(
    "cloud",
    [make_cloud(1), make_cloud(2, 1), make_cloud(63, 3), real_cloud(700), clustered_cloud(900, 2)],
    ids=["one", "two", "no levels", "trained", "clusters"],
)
def test_a_reader_gets_the_state(cloud: GaussianCloud, coarse_log2: int) -> None:
    target, shape = task(cloud, coarse_log2)
    streams, written = write(target, shape)
    assert len(streams) == len(shape.steps.steps) + 2
    found = read(streams, shape)
    assert found.hash() == written.hash()
    assert np.array_equal(found.covers(), target.cover)


def test_every_value_is_within_half_its_step() -> None:
    target, shape = task(real_cloud(1500), alternating=False)
    _, state = write(target, shape)
    steps = steps_in_intra_frame(state, shape.units, shape.steps)
    scales, wanted = (
        p[Attribute.SCALE] for p in ({a: p.wide() for a, p in state.planes.items()}, target.planes)
    )
    for attribute, plane in state.planes.items():
        if attribute == Attribute.SCALE:
            assert (2 * np.abs(scales - wanted)[:, :2] <= steps[attribute][:, :2] + 1).all()
            # how thin: to the decoded axis 1, in zones as wide as the coarser of the two
            exact, exponent = scales[:, 1] - wanted[:, 2], shape.units.scale
            error, zones = np.abs(scales[:, 2] - wanted[:, 2]), thin_octaves(exact, exponent, 6)
            assert (
                2 * error <= np.maximum(steps[attribute][:, 2], steps[attribute][:, 0] << zones) + 128
            ).all()
        elif attribute == Attribute.OPACITY:
            goal = target.column(attribute, 0, {Attribute.SCALE: scales}, [])
            error = np.abs(plane.wide()[:, 0] - goal.values)[:, None]
            assert (2 * error <= steps[attribute] + 1).all()
        elif attribute != Attribute.ROTATION:
            error = np.abs(plane.wide() - target.planes[attribute])
            assert (2 * error <= steps[attribute] + 1).all(), attribute
    # and not all have the same
    for attribute in (Attribute.POSITION, Attribute.SCALE, Attribute.OPACITY, Attribute.SH_DC):
        assert len(np.unique(steps[attribute])) > 1


def test_two_quantisers_are_nearer_in_every_attribute_but_positions() -> None:
    target, shape = task(real_cloud(3000))
    assert shape.steps.alternating == shape.steps.steps.keys() - {Attribute.POSITION}
    alone, plain = task(real_cloud(3000), alternating=False)
    _, state = write(target, shape)
    _, other = write(alone, plain)
    for attribute in (Attribute.SCALE, Attribute.OPACITY, Attribute.SH_DC):
        # the third axis is companded and has one quantiser
        error, more = (
            np.mean((found.planes[attribute].wide() - target.planes[attribute])[:, :2] ** 2.0)
            for found in (state, other)
        )
        assert error < 0.9 * more, attribute


def test_thin_axes_cost_less_the_thinner_they_are() -> None:
    cloud = real_cloud(1500)
    scales = np.sort(cloud.scales, axis=1)[:, ::-1]
    spread = np.random.default_rng(3).uniform(0, 5, 1500)
    thin = replace(
        cloud, scales=np.stack([scales[:, 0], scales[:, 1], scales[:, 1] - spread], axis=1).astype(np.float32)
    )
    target, shape = task(thin)
    assert shape.steps.thin_octaves == 6
    plain_steps = replace(shape.steps, thin_octaves=0)
    plain_target, plain = replace(target, steps=plain_steps), replace(shape, steps=plain_steps)
    stream = 2
    assert len(write(target, shape)[0][stream]) < 0.9 * len(write(plain_target, plain)[0][stream])
    same = {a: p.values for a, p in write(plain_target, plain)[1].planes.items()}
    assert np.array_equal(
        same[Attribute.SCALE][:, :2], write(target, shape)[1].planes[Attribute.SCALE].values[:, :2]
    )


def test_third_axes_do_not_grow_however_coarse_their_steps() -> None:
    cloud = real_cloud(1500)
    target, shape = task(cloud, cover=np.random.default_rng(2).uniform(0, 15, 1500))
    coarse = {a: step << 4 if a == Attribute.SCALE else step for a, step in shape.steps.steps.items()}
    shape = replace(shape, steps=replace(shape.steps, steps=coarse))
    scales = write(target, shape)[1].planes[Attribute.SCALE].wide() * 2.0**shape.units.scale
    assert (scales[:, 2] - scales[:, 1]).max() <= 0.36


def test_thin_axes_out_of_range_are_refused() -> None:
    target, shape = task(make_cloud(200))
    planes = dict(target.planes)
    planes[Attribute.SCALE] = planes[Attribute.SCALE].copy()
    planes[Attribute.SCALE][5, 2] = -2 * STATE_LIMIT
    steps = replace(shape.steps, thin_octaves=MAX_THIN_OCTAVES)
    with pytest.raises(CorruptBitstream, match="leaves the range"):
        write(replace(target, planes=planes, steps=steps), replace(shape, steps=steps))


def test_bounded_scales_are_not_companded() -> None:
    cloud = real_cloud(300)
    quantisation = plan_quantisation(28, (Bound("scale", 0.01),), cloud)
    planes = {a: p.wide() for a, p in state_of(cloud, quantisation.units).planes.items()}
    assert IntraPlan.of(planes, np.zeros(300, np.int64), quantisation).steps.thin_octaves == 0


def test_covered_gaussians_are_coarser() -> None:
    cloud = real_cloud(1500)
    cover = np.where(np.arange(1500) % 2, 0.0, 6.0)
    target, shape = task(cloud, cover=cover)
    _, state = write(target, shape)
    error = np.abs(state.planes[Attribute.SH_DC].wide() - target.planes[Attribute.SH_DC]).mean(axis=1)
    assert error[target.cover > 4].mean() > 2 * error[target.cover < 2].mean()


def test_cover_costs_next_to_nothing_where_there_is_none() -> None:
    target, shape = task(real_cloud(1500), cover=np.zeros(1500))
    assert len(write(target, shape)[0][1]) <= 12


@pytest.mark.parametrize("value", [-1, MAX_COVER + 1])
def test_unknown_cover_classes_are_refused(value: int) -> None:
    target, shape = task(make_cloud(200))
    cover = target.cover.copy()
    cover[7] = value
    with pytest.raises(CorruptBitstream, match="cover class"):
        write(replace(target, cover=cover), shape)
