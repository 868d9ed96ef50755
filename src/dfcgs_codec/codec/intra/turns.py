"""Rotations of an I-frame: the pole's tilt, then the turn about it (spec section 11.5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64, UInt8
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.column import scaled_symbols
from dfcgs_codec.core import procedures
from dfcgs_codec.entropy.symbols import Groups, code_residuals, code_with_models
from dfcgs_codec.transform.lod import NUM_NEIGHBOURS, Level, LevelsOfDetail, ladder
from dfcgs_codec.transform.pole import axes_of_quaternions, predict_poles, rest_frames
from dfcgs_codec.transform.rotation import CELLS, ONE, from_stereo, multiply, normalise

#: half octaves of the angle that is expected, in symbols; the last one of each sort belongs to the base
NUM_SORT_CONTEXTS = 32
NUM_CONTEXTS = 2 * NUM_SORT_CONTEXTS
#: squares of angles in 1/32 of squared steps
_SQUARE_BITS = 5
#: a stereographic unit turns by four radians: half the square of an angle is 8 squares of it
_STEREO_SQUARE_LOG2 = 3

#: names of a Gaussian: half turns about its axes (spec section 9.4)
_NUM_FLIPS = 4


@dataclass
class Turns:
    """Symbols of rows: tilts (rows, 2), spins (rows,), flips (rows,) 0 to 3."""

    tilts: Int64
    spins: Int64
    flips: Int64


#: contexts of tilts and of spins, (rows,) each
TurnContexts = tuple[UInt8, UInt8]
#: an encoder's choice of symbols, from the frames expected (rows, 4) of a pass and the contexts
ChooseTurns = Callable[[slice, Int64, TurnContexts], Turns]


def pole_turns(tilts: Int64, spins: Int64, is_needle: Bool) -> tuple[Int64, Int64]:
    """Quaternions of stereographic tilts (rows, 2) and spins (rows,)."""
    count = len(spins)
    tilt, spin = np.zeros((count, 3), np.int64), np.zeros((count, 3), np.int64)
    tilt[:, 1] = np.where(is_needle, tilts[:, 0], tilts[:, 1])
    tilt[:, 0] = np.where(is_needle, 0, tilts[:, 0])
    tilt[:, 2] = np.where(is_needle, tilts[:, 1], 0)
    spin[:, 0] = np.where(is_needle, spins, 0)
    spin[:, 2] = np.where(is_needle, 0, spins)
    return from_stereo(tilt), from_stereo(spin)


def _contexts(expected: Int64 | None, steps: Int64, is_needle: Bool) -> UInt8:
    sort = np.where(is_needle, NUM_SORT_CONTEXTS, 0)
    if expected is None:
        first: UInt8 = (sort + NUM_SORT_CONTEXTS - 1).astype(np.uint8)
        return first
    # Q36 of half squares to squares of stereographic units, 2 * 18 bits
    squares = (expected << _SQUARE_BITS >> _STEREO_SQUARE_LOG2) // (steps * steps)
    step = (ladder(squares, 2 * NUM_SORT_CONTEXTS) + 1) >> 1
    contexts: UInt8 = (sort + np.minimum(step, NUM_SORT_CONTEXTS - 2)).astype(np.uint8)
    return contexts


@dataclass(frozen=True)
class TurnWalk:
    """Steps (N,) of tilts and spins, in stereographic units, whose pole is axis 0 (N,), levels of detail.

    `alternating`: whether two quantisers take turns, in tilts and in spins.
    """

    tilt_steps: Int64
    spin_steps: Int64
    is_needle: Bool
    lod: LevelsOfDetail
    alternating: bool = False

    def code(self, coder: SymbolCoder, choose: ChooseTurns | None, *, keeps_names: bool = False) -> Int64:
        """Quaternions (N, 4), as decoded.

        `choose`: None when reading. `keeps_names`: whether to write flips, so that each is named as wanted.
        """
        count = len(self.is_needle)
        known = Turns(np.zeros((count, 2), np.int64), np.zeros(count, np.int64), np.zeros(count, np.int64))
        contexts = np.zeros(count, np.uint8), np.zeros(count, np.uint8)
        if choose is not None:
            self._choose(known, contexts, choose)
        tilt_tables = coder.tables(
            NUM_CONTEXTS, lambda: (known.tilts.T.ravel(), np.concatenate([contexts[0]] * 2))
        )
        spin_tables = coder.tables(NUM_CONTEXTS, lambda: (known.spins, contexts[1]))
        has_flips = coder.choice(2, lambda: int(keeps_names and bool(known.flips.any())))
        flips = None
        if has_flips:
            flips = coder.histograms(
                np.zeros(1, np.int64), 1, _NUM_FLIPS, lambda: (known.flips, np.zeros(count, np.uint8))
            )

        def code_rows(rows: slice, _: Int64, contexts: TurnContexts) -> Turns:
            given = None
            if choose is not None:
                given = Turns(known.tilts[rows], known.spins[rows], known.flips[rows])
            wanted = None if given is None else given.tilts.T.ravel()
            both = code_residuals(coder, wanted, np.concatenate([contexts[0]] * 2), tilt_tables)
            spins = code_residuals(coder, None if given is None else given.spins, contexts[1], spin_tables)
            found = Turns(both.reshape(2, -1).T, spins, np.zeros(len(spins), np.int64))
            if flips is not None:
                groups = Groups(np.zeros(len(spins), np.uint8), 1)
                found.flips = code_with_models(coder, None if given is None else given.flips, groups, flips)
            return found

        return self._walk(code_rows)

    def tilts_of(self, symbols: Int64, steps: Int64) -> Int64:
        """Tilts (rows, 2) of a pass: all first ones, then all second ones, are coded as one."""
        flat = scaled_symbols(symbols.T.ravel(), np.tile(steps, 2), alternating=self.alternating)
        return flat.reshape(2, -1).T

    def _choose(self, known: Turns, contexts: TurnContexts, choose: ChooseTurns) -> None:
        """Fill in symbols and contexts: the walk, with nothing coded."""

        def choose_rows(rows: slice, frames: Int64, found: TurnContexts) -> Turns:
            contexts[0][rows], contexts[1][rows] = found
            chosen = choose(rows, frames, found)
            known.tilts[rows], known.spins[rows], known.flips[rows] = chosen.tilts, chosen.spins, chosen.flips
            return chosen

        self._walk(choose_rows)

    def _walk(self, code_rows: Callable[[slice, Int64, TurnContexts], Turns]) -> Int64:
        count = len(self.is_needle)
        quaternions = np.zeros((count, 4), np.int64)
        axes = np.zeros((count, 3, 3), np.int64)
        for rows, level in ((self.lod.base, None), *((level.rows, level) for level in self.lod.levels)):
            is_needle = self.is_needle[rows]
            frames, tilt, spin = self._expected(rows, level, axes)
            steps = self.tilt_steps[rows], self.spin_steps[rows]
            contexts = _contexts(tilt, steps[0], is_needle), _contexts(spin, steps[1], is_needle)
            found = code_rows(rows, frames, contexts)
            tilts = self.tilts_of(found.tilts, steps[0])
            spins = scaled_symbols(found.spins, steps[1], alternating=self.alternating)
            tilted, spun = pole_turns(tilts, spins, is_needle)
            turned = normalise(multiply(multiply(frames, tilted), spun))
            axes[rows] = axes_of_quaternions(turned)
            flipped = np.flatnonzero(found.flips)
            turned[flipped] = multiply(turned[flipped], CELLS[found.flips[flipped]] * ONE)
            quaternions[rows] = turned
        return quaternions

    def _expected(
        self, rows: slice, level: Level | None, axes: Int64
    ) -> tuple[Int64, Int64 | None, Int64 | None]:
        """Frames, and half the squares of the angles that symbols are expected to have."""
        is_needle = self.is_needle[rows]
        if level is None:
            return rest_frames(len(is_needle)), None, None
        if procedures.is_worth(len(is_needle)) and level.weights.shape[1] == len(is_needle):
            return procedures.expect_turns(axes, self.is_needle, level.weights, level.step.bit_length() - 2)
        return self._predicted(is_needle, level, axes)

    @staticmethod
    def _predicted(is_needle: Bool, level: Level, axes: Int64) -> tuple[Int64, Int64, Int64]:
        coarse = axes[:: level.step]
        padded = np.pad(coarse, ((NUM_NEIGHBOURS // 2,) * 2, (0, 0), (0, 0)), mode="edge")
        count = len(is_needle)
        neighbours = np.stack([padded[k + 1 : k + 1 + count] for k in range(NUM_NEIGHBOURS)])
        weights = np.broadcast_to(level.weights.astype(np.int64), (NUM_NEIGHBOURS, count))
        found = predict_poles(neighbours, weights, is_needle)
        return found.frames, found.tilt, found.spin
