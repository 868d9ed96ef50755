"""Legal streams with choices that no sensible encoder makes, from random numbers.

Tests decode many of them with two decoders; `make golden` keeps some as conformance streams.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np

from dfcgs_codec import GaussianCloud
from dfcgs_codec.bitstream import constants
from dfcgs_codec.bitstream.constants import Attribute, OutputOrder, Profile
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps, SortGrid
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.codec.columns.side_information import (
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.topology import TopologyGoal
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.residual.classes import BLOCK_LOG2, AttributeActivity, InterSymbols
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.frame import chunk_writer, frame_coding
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from dfcgs_codec.model import registry
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from dfcgs_codec.transform.rotation import normalise


def random_cloud(rng: np.random.Generator, count: int, sh_degree: int) -> GaussianCloud:
    """Gaussians that have nothing to do with each other."""
    shape = (count, 3, SH_REST_COEFFICIENTS[sh_degree])
    return GaussianCloud(
        positions=rng.normal(size=(count, 3)).astype(np.float32),
        rotations=rng.normal(size=(count, 4)).astype(np.float32),
        scales=rng.normal(-4, 1, (count, 3)).astype(np.float32),
        opacities=rng.normal(0, 4, count).astype(np.float32),
        sh_dc=rng.normal(size=(count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, shape).astype(np.float32),
    )


class _RandomWriter(SymbolWriter):
    """Settles at random how symbols are coded."""

    rng = np.random.default_rng(0)

    def weights(self, count: int, evidence: Any) -> Any:
        weights = self.rng.integers(-90, 90, count) * (self.rng.random(count) < 0.6)
        weights[0] = self.rng.choice([0, 0, 100, 256, 400])
        return code_weights(self, weights, count)

    def tables(self, num_contexts: int, evidence: Any) -> Any:
        chosen = np.full(num_contexts, -1, np.int64)
        first = int(self.rng.integers(num_contexts))
        for context in range(first, int(self.rng.integers(first, num_contexts)) + 1):
            chosen[context] = self.rng.integers(480) if self.rng.random() < 0.7 else 160 + 40
        return code_tables(self, chosen, num_contexts)

    def histograms(self, used: Any, num_contexts: int, size: int, evidence: Any) -> Any:
        levels = self.rng.integers(0, 64, (len(used), size))
        levels[:, self.rng.integers(size)] = self.rng.integers(0, 63)
        return histogram_models(self, levels, used, num_contexts, size)

    def choice(self, size: int, evidence: Callable[[], int]) -> int:
        return super().choice(size, lambda: int(self.rng.integers(size)))

    def predictor(self, num_before: int, evidence: Any) -> Any:
        center = code_signed(self, int(self.rng.integers(-50, 50)), constants.STATE_LIMIT)
        return center, self.weights(1 + num_before, None), self.weights(2 + num_before, None)


def _random_indices(rng: np.random.Generator, count: int, grid: SortGrid) -> Any:
    """Coarse indices in canonical order."""
    indices = rng.integers(-20, 40, (count, 3))
    indices[rng.random(count) < 0.3] = indices[0]
    if grid.has_excess:
        indices[rng.random(count) < 0.1] *= int(rng.integers(1, 5000))
    wide = (indices >> grid.shift) - np.array(grid.origin)
    top = (1 << grid.bits) - 1
    if not grid.has_excess:
        wide = np.clip(wide, 0, top)
        indices = ((wide + np.array(grid.origin)) << grid.shift) | (indices & ((1 << grid.shift) - 1))
    return indices[canonical_order(morton_keys(np.clip(wide, 0, top)), indices)]


@dataclass
class _FlaggedActivity(AttributeActivity):
    """With flags on Gaussians that have no symbols, too."""

    flagged: Any = False

    def significant(self) -> Any:
        return super().significant() | self.flagged


def _inter_symbols(rng: np.random.Generator, planes: list[Attribute], count: int) -> InterSymbols:
    activity: dict[Attribute, AttributeActivity] = {}
    block = np.arange(count) >> BLOCK_LOG2
    for attribute in planes:
        if rng.random() < 0.3:
            continue
        columns = 3 if attribute == Attribute.ROTATION else constants.STATE_COLUMNS[attribute]
        share = rng.choice([0.0, 0.05, 0.5, 1.0])
        symbols = rng.integers(-30, 30, (count, columns)) * (rng.random((count, columns)) < share)
        significant = np.zeros(block[-1] + 1, bool)
        np.logical_or.at(significant, block, symbols.any(axis=1))
        density = np.where(
            significant, rng.integers(1, 4, len(significant)), rng.integers(0, 4, len(significant))
        )
        if rng.random() < 0.3:
            density[:] = 3
        # beyond the 24 classes, too: decoders clip
        magnitude = np.where(density > 0, rng.integers(-3, 30, len(density)), 0)
        flagged = rng.random(count) < rng.choice([0.0, 0.3])
        flagged &= density[block] > 0
        activity[attribute] = _FlaggedActivity(
            symbols.astype(np.int64), density, magnitude, None, None, flagged
        )
    return InterSymbols(activity)


def _random_grid(rng: np.random.Generator) -> SortGrid:
    origin = tuple(rng.integers(-30, 30, 3).tolist())
    return SortGrid(int(rng.integers(0, 3)), int(rng.integers(0, 7)), origin, bool(rng.integers(2)))


def _random_control(rng: np.random.Generator) -> ControlHeader:
    return ControlHeader(int(rng.choice([1, 2, 7, 1000])), int(rng.integers(0, 9)))


def _random_motion(rng: np.random.Generator, before: GofState) -> MotionGoal | None:
    if rng.random() < 0.3:
        return None
    motion = before.motion()
    points, count = motion.field.num_points, before.frame.num_gaussians
    header = MotionHeader(
        int(rng.integers(1, 300)),
        int(rng.choice([0, 1, 900])),
    )
    control = rng.integers(-9, 10, (points, 6)) * (rng.random((points, 6)) < rng.random())
    control[:, header.num_columns :] = 0
    follows = rng.random(count) < rng.choice([0.0, 0.5, 1.0])
    symbols = MotionSymbols(control, classify_modes(follows), follows)
    return MotionGoal(header, symbols, motion.carry(header, symbols, before.frame))


def _random_topology(
    rng: np.random.Generator, before: GofState, attributes: list[Attribute]
) -> TopologyGoal | None:
    if rng.random() < 0.4:
        return None
    count = before.frame.num_gaussians
    kept = np.flatnonzero(rng.random(count) < rng.choice([0.3, 0.9, 1.0]))
    if len(kept) == 0:
        kept = rng.integers(0, count, 1)
    num_births = int(rng.choice([0, 1, 30, 150]))
    births = None
    if num_births:
        births = _random_task(rng, num_births, attributes, before.visibility.units)
        births = replace(births, permutation=None)
    total = len(kept) + num_births
    inputs = rng.permutation(total) if rng.random() < 0.4 else None
    return frame_coding.topology_goal(kept, count, births, inputs)


class _Target(IntraTarget):
    """Coded stream after stream, so that the same random numbers meet the same symbols."""

    def beside(self, work: Callable[[], None]) -> Callable[[], None]:
        work()
        return lambda: None


def _random_task(
    rng: np.random.Generator, count: int, attributes: list[Attribute], units: UnitExponents
) -> IntraTarget:
    """An I-frame, or births."""
    grid, log2 = _random_grid(rng), int(rng.choice([0, 0, 1, 3, 8]))
    coarse = _random_indices(rng, count, grid)
    steps = {attribute: int(rng.integers(1, 400)) for attribute in attributes}
    # beyond the cube of the stereographic vector, too
    steps[Attribute.ROTATION] = int(rng.integers(1, 6000))
    # so that far outliers stay on the grid
    steps[Attribute.POSITION] = max(1, steps[Attribute.POSITION] >> log2)
    levels = {attribute: int(rng.integers(-300, 500)) for attribute in attributes}
    alternating = frozenset(a for a in attributes if a != Attribute.POSITION and rng.random() < 0.7)
    rule = IntraSteps(steps, log2, levels, int(rng.choice([0, 1, 6, 8])), alternating)
    planes = {
        a: np.cumsum(rng.integers(-900, 900, (count, constants.STATE_COLUMNS[a])), axis=0) for a in attributes
    }
    planes[Attribute.ROTATION] = normalise(rng.integers(-(1 << 23), 1 << 23, (count, 4)))
    bounded = frozenset(a for a in attributes if a == Attribute.OPACITY or rng.random() < 0.3)
    return _Target(
        planes,
        coarse << log2 | rng.integers(0, 1 << log2, coarse.shape),
        np.clip(rng.integers(-4, 5, count).cumsum() // 4, 0, 15) * int(rng.integers(0, 2)),
        rule,
        grid,
        Quantisation(units, {}, bounded, {}, frozenset()),
        0.6,
        rng.permutation(count) if rng.random() < 0.5 else None,
        bool(rng.integers(0, 2)),
    )


def _random_intra(
    rng: np.random.Generator, index: int, attributes: list[Attribute], header: SequenceHeader
) -> frame_coding.CodedFrame:
    # passes with two quantisers, now and then
    count = int(rng.integers(1, rng.choice([20, 200, 200, 1200])))
    model = registry.context_model(header.model_id)
    control, writer = _random_control(rng), FrameWriter(header, model, index)
    if rng.random() < 0.3:
        permutation = rng.permutation(count) if rng.random() < 0.5 else None
        cloud = random_cloud(rng, count, header.sh_degree)
        return frame_coding.coded_verbatim(writer, cloud, permutation, control)
    task = _random_task(rng, count, attributes, header.unit_exponents)
    return frame_coding.coded_intra(writer, task, control)


def _random_inter(
    rng: np.random.Generator,
    writer: FrameWriter,
    attributes: list[Attribute],
    before: frame_coding.CodedFrame,
) -> frame_coding.CodedFrame:
    present = attributes if rng.random() < 0.8 else []
    change = _random_topology(rng, before.state, attributes)
    state = before.state
    if change is not None:
        state = state.survivors(change.kept)
    symbols = _inter_symbols(rng, present, state.frame.num_gaussians)
    steps = {attribute: int(rng.integers(1, 3000)) for attribute in attributes}
    trial = _random_motion(rng, state)
    levels = {}
    if rng.random() < 0.6:
        levels = {attribute: int(rng.integers(-500, 500)) for attribute in attributes}
    coded = frame_coding.coded_inter(writer, symbols, before.state, (steps, levels), trial, change)
    for activity in coded.state.history.activity.values():
        np.clip(activity.magnitude, 0, 23, out=activity.magnitude)
    return coded


def _file(rng: np.random.Generator, model: ContextModel, num_frames: int) -> bytes:
    sh_degree = int(rng.integers(2))
    attributes = list(Attribute)[: Attribute.SH_1 + sh_degree]
    numbers = FrameNumbers.of(sorted(rng.choice(2 * num_frames, num_frames, replace=False).tolist()))
    units = UnitExponents(*rng.integers(-16, -10, 4).tolist())
    header = SequenceHeader(Profile.MAIN, 1, sh_degree, OutputOrder.FREE, (25, 1), numbers, units)
    header = replace(header, model_id=model.model_id, model_hash=model.digest[:8])
    file = io.BytesIO()
    writer = ContainerWriter(file, header)
    coded = None
    gofs: list[list[bytes]] = []
    for index in range(num_frames):
        if coded is None or rng.random() < 0.2:
            coded = _random_intra(rng, index, attributes, header)
            gofs.append([])
        else:
            coded = _random_inter(rng, FrameWriter(header, model, index), attributes, coded)
        gofs[-1].append(coded.data)
    first = 0
    for chunks in gofs:
        writer.gof(first, chunks)
        first += len(chunks)
    writer.finish()
    return file.getvalue()


def random_file(seed: int, model: ContextModel, num_frames: int = 6) -> bytes:
    """A file of profile MAIN, coded with the registered `model`; the same each time."""
    rng = np.random.default_rng(seed)
    with (
        mock.patch.object(chunk_writer, "SymbolWriter", _RandomWriter),
        mock.patch.object(_RandomWriter, "rng", rng),
    ):
        return _file(rng, model, num_frames)
