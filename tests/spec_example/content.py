"""What the example is made of, and the encoder that makes it: the simplest choices that use the format.

No float decides anything, so that the file changes only when the format or the prior does.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from unittest import mock

import numpy as np

from dfcgs_codec.array_types import Int64, UInt8
from dfcgs_codec.bitstream.constants import (
    MODEL_HASH_BYTES,
    STATE_LIMIT,
    Attribute,
    ChunkType,
    OutputOrder,
    Profile,
)
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps, SortGrid
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.codec.columns.coder import (
    ColumnFacts,
    HistogramEvidence,
    ResidualEvidence,
    SplitEvidence,
    WeightEvidence,
)
from dfcgs_codec.codec.columns.column import ColumnGoal
from dfcgs_codec.codec.columns.side_information import (
    ABSENT_LEVEL,
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.intra.turns import ChooseTurns, TurnContexts, Turns, TurnWalk
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.residual.classes import AttributeActivity, InterSymbols
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.frame import chunk_writer, frame_coding
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.entropy.coder import Model
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape, scale_table
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from dfcgs_codec.transform.rotation import round_divide

_FLAT_BIAS = 5
_WHOLE = 256

_PRIOR = context_model(DEFAULT_PRIOR)
_HEADER = SequenceHeader(
    profile=Profile.MAIN,
    level=1,
    sh_degree=0,
    output_order=OutputOrder.FREE,
    frame_rate=(30, 1),
    frame_numbers=FrameNumbers(((7, 2),)),
    unit_exponents=UnitExponents(position=-4, scale=-12, opacity=-12, color=-12),
    model_id=_PRIOR.model_id,
    model_hash=_PRIOR.digest[:MODEL_HASH_BYTES],
)
_STEPS = {
    Attribute.POSITION: 4,
    Attribute.SCALE: 512,
    Attribute.ROTATION: 4096,
    Attribute.OPACITY: 512,
    Attribute.SH_DC: 512,
}
_COARSE_LOG2 = 1
#: weights of what shows most lie above these, of what shows least far below: steps differ
_INTRA_STEPS = IntraSteps(
    _STEPS,
    coarse_log2=_COARSE_LOG2,
    levels={
        Attribute.POSITION: -20,
        Attribute.SCALE: 0,
        Attribute.ROTATION: -120,
        Attribute.OPACITY: -80,
        Attribute.SH_DC: -100,
    },
    thin_octaves=2,
    alternating=frozenset({Attribute.SH_DC}),
)
_INTER_LEVELS = dict.fromkeys(_STEPS, -1000) | {Attribute.POSITION: 0, Attribute.SH_DC: -160}
_GRID = SortGrid(shift=0, bits=5, origin=(0, 0, 0), has_excess=False)
_CONTROL = ControlHeader(spacing=22, shift=4)
_MOTION = MotionHeader(translation_step=2, turn_step=4096)
_CONTROL_SYMBOLS = np.array([[2, -1, 0, 0, 0, 2], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0]])


def _patch() -> Int64:
    """Positions (66, 3) on a curved patch, in steps and in canonical order."""
    i = np.arange(66)
    x, y = 3 * (i % 11), 4 * (i // 11)
    index = np.stack([x, y, (x * y >> 4) + i % 3], axis=1)
    coarse = index >> _COARSE_LOG2
    return index[canonical_order(morton_keys(coarse), coarse)]


_POSITIONS = _patch()
_X, _Y, _Z = _POSITIONS.T
_ROWS = np.arange(len(_POSITIONS))
#: in steps; the third column of scales: how thin axis 2 is
_COLUMNS = {
    Attribute.SCALE: np.stack([(_X >> 2) - 40, (_X >> 2) - 42 - (_Y >> 3), (_X + _Y) % 5], axis=1),
    Attribute.OPACITY: (_Z % 20 - 3)[:, None],
    Attribute.SH_DC: np.stack([(_X >> 1) - 6, 3 - (_Y >> 2), (_Z >> 2) - 2], axis=1),
}
_COVER = np.where(_Y == 0, 2, 0)
_TURNS = Turns(np.stack([_ROWS % 3 - 1, _ROWS % 2], axis=1), _ROWS % 5 - 2, np.where(_ROWS % 16 == 5, 2, 0))
_FOLLOWS = _X < 12
#: of few Gaussians positions and rotations, of all the colours
_INTER = {
    Attribute.POSITION: np.where((_ROWS % 9 == 4)[:, None], [1, 0, -1], 0),
    Attribute.ROTATION: np.where((_ROWS == 33)[:, None], [0, 2, 0], 0),
    Attribute.SH_DC: np.stack([_X // 12, -(_Y // 12), _ROWS % 7 // 6], axis=1),
}
_FEW, _ALL = 1, 3


class PlainWriter(SymbolWriter):
    """Predicts from neighbours alone, and has Laplace tables without escapes."""

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """The neighbours' mean, or deviation, counts whole; nothing else does."""
        return code_weights(self, np.eye(1, count, dtype=np.int64)[0] * _WHOLE, count)

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """The smallest Laplace scale without escapes, for each context from the first to the last used."""
        residuals, contexts = evidence()
        tables = np.full(num_contexts, -1, np.int64)
        scale = 0
        for context in range(int(contexts.min()), int(contexts.max()) + 1):
            largest = int(np.abs(residuals[contexts == context]).max(initial=-1))
            if largest >= 0:
                scale = next(s for s in range(64) if len(scale_table(Shape.LAPLACE, s)) // 2 > largest)
            tables[context] = Shape.LAPLACE * NUM_SCALES + scale
        return code_tables(self, tables, num_contexts)

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """Level 0 for every symbol that occurs, absent for the others."""
        symbols, contexts = evidence()
        levels = np.full((len(used), size), ABSENT_LEVEL, np.int64)
        levels[np.searchsorted(used, contexts), symbols] = 0
        return histogram_models(self, levels, used, num_contexts, size)

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """The value in the middle, and the weights that `weights` takes."""
        values = np.sort(evidence().values)
        center = code_signed(self, int(values[len(values) // 2]), STATE_LIMIT)
        return center, self.weights(1 + num_before, _nothing), self.weights(2 + num_before, _nothing)

    def split_bias(self, evidence: SplitEvidence) -> int:
        """That of cells whose halves hold any number of Gaussians with the same probability."""
        return self.choice(16, lambda: _FLAT_BIAS)


def _nothing() -> tuple[list[Int64], Int64]:
    return [], np.zeros(0, np.int64)


class _Target(IntraTarget):
    """Columns to the nearest value, turns as they are given."""

    def column(
        self, attribute: Attribute, column: int, decoded: Mapping[Attribute, Int64], before: list[Int64]
    ) -> ColumnGoal:
        """See IntraGoal."""
        values = _COLUMNS[attribute][:, column] * _STEPS[attribute]

        def choose(rows: slice, prediction: Int64, steps: Int64, _: UInt8) -> Int64:
            return round_divide(values[rows] - prediction, steps)

        return ColumnGoal(values, choose)

    def turns(self, walk: TurnWalk) -> ChooseTurns:
        """See IntraGoal."""

        def choose(rows: slice, _: Int64, __: TurnContexts) -> Turns:
            return Turns(_TURNS.tilts[rows], _TURNS.spins[rows], _TURNS.flips[rows])

        return choose

    def beside(self, work: Callable[[], None]) -> Callable[[], None]:
        """See IntraGoal."""
        work()
        return lambda: None


def _target() -> _Target:
    unused = Quantisation(_HEADER.unit_exponents, {}, frozenset(), {}, frozenset())
    return _Target({}, _POSITIONS, _COVER, _INTRA_STEPS, _GRID, unused, 0.5, None, keeps_names=True)


def _inter_symbols() -> InterSymbols:
    activity = {}
    for attribute, symbols in _INTER.items():
        in_blocks = [symbols[:64].any(), symbols[64:].any()]
        density = np.where(in_blocks, _ALL if attribute == Attribute.SH_DC else _FEW, 0)
        activity[attribute] = AttributeActivity(symbols, density, np.where(density, 5, 0))
    return InterSymbols(activity)


def _motion(intra: frame_coding.CodedFrame) -> MotionGoal:
    """Two of three control points move; Gaussians on the left follow."""
    motion = intra.state.motion()
    symbols = MotionSymbols(_CONTROL_SYMBOLS, classify_modes(_FOLLOWS), _FOLLOWS)
    return MotionGoal(_MOTION, symbols, motion.carry(_MOTION, symbols, intra.state.frame))


def build() -> bytes:
    """The file."""
    file = io.BytesIO()
    container = ContainerWriter(file, _HEADER)
    container.chunk(ChunkType.ENCODER_INFO, 0, b"worked example")
    with mock.patch.object(chunk_writer, "SymbolWriter", PlainWriter):
        intra = frame_coding.coded_intra(FrameWriter(_HEADER, _PRIOR, 0), _target(), _CONTROL)
        writer = FrameWriter(_HEADER, _PRIOR, 1)
        steps = _STEPS, _INTER_LEVELS
        inter = frame_coding.coded_inter(writer, _inter_symbols(), intra.state, steps, _motion(intra))
    container.gof(0, [intra.data, inter.data])
    container.finish()
    return file.getvalue()
