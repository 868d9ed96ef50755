"""The symbol walk of a frame's motion: who follows, and how the control points move (spec section 14.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.motion.control_points import NUM_COLUMNS, ControlPrior
from dfcgs_codec.codec.residual.classes import BLOCK_LOG2, num_blocks
from dfcgs_codec.entropy.symbols import Groups, code_with_models

#: classes of blocks: all Gaussians stand still, all follow, each has a flag
STILL, FOLLOW, MIXED = range(3)
NUM_MODES = 3


@dataclass(frozen=True)
class MotionSymbols:
    """What a MOTION chunk carries.

    `control` int64 (n, 6): symbols of translation and turn, zero where nothing turns;
    `modes` int64 (blocks,): STILL, FOLLOW or MIXED; `follows` bool (N,).
    """

    control: Int64
    modes: Int64
    follows: Bool

    def merged(self, num_births: int, source: Int64) -> MotionSymbols:
        """After Gaussians went and came; births followed nobody, modes are forgotten."""
        follows = np.concatenate([self.follows, np.zeros(num_births, np.bool_)])[source]
        return MotionSymbols(self.control, np.zeros(num_blocks(len(follows)), np.int64), follows)

    @staticmethod
    def none(num_points: int, num_gaussians: int) -> MotionSymbols:
        """All stand still."""
        control = np.zeros((num_points, NUM_COLUMNS), np.int64)
        modes = np.zeros(num_blocks(num_gaussians), np.int64)
        return MotionSymbols(control, modes, np.zeros(num_gaussians, np.bool_))


@dataclass(frozen=True)
class MotionShape:
    """What headers and control points say that the walk needs.

    `order` (n,): ranks of the control points, in GoF order; `num_columns` 3 or 6.
    """

    order: Int64
    num_columns: int
    prior: ControlPrior


def _code_modes(coder: SymbolCoder, modes: Int64 | None, before: Int64) -> Int64:
    known = np.zeros(0, np.int64) if modes is None else modes
    contexts = before.astype(np.uint8)
    groups = Groups(contexts, NUM_MODES)
    models = coder.histograms(groups.used, NUM_MODES, NUM_MODES, lambda: (known, contexts))
    return code_with_models(coder, modes, groups, models)


def _code_follows(coder: SymbolCoder, follows: Bool | None, mode: Int64, before: Bool) -> Bool:
    """Who follows; `mode` (N,) of each Gaussian's block; context: whether it followed before."""
    result: Bool = mode == FOLLOW
    rows = np.flatnonzero(mode == MIXED)
    if len(rows):
        given = None if follows is None else follows[rows].astype(np.int64)
        known = np.zeros(0, np.int64) if given is None else given
        contexts = before[rows].astype(np.uint8)
        groups = Groups(contexts, 2)
        models = coder.histograms(groups.used, 2, 2, lambda: (known, contexts))
        result[rows] = code_with_models(coder, given, groups, models) > 0
    return result


def code_motion(
    next_coder: Callable[[], SymbolCoder],
    symbols: MotionSymbols | None,
    history: MotionSymbols,
    shape: MotionShape,
) -> MotionSymbols:
    """Both streams of a MOTION chunk; `history`: what the GoF's last one carried; returns the symbols."""
    coder = next_coder()
    modes = _code_modes(coder, None if symbols is None else symbols.modes, history.modes)
    block = np.arange(len(history.follows)) >> BLOCK_LOG2
    given = None if symbols is None else symbols.follows
    follows = _code_follows(coder, given, modes[block], history.follows)
    order, num_columns = shape.order, shape.num_columns
    control = np.zeros((len(order), NUM_COLUMNS), np.int64)
    target = None if symbols is None else symbols.control[order]
    before = history.control[order]
    control[order, :num_columns] = shape.prior.code(next_coder(), target, order, before, num_columns)
    return MotionSymbols(control, modes, follows)
