"""P-frames of profile `paper`: latents to motion, motion to a frame, colours refined (spec annex B)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.motion_header import LatentHeader, SpreadHeader
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.motion.compensation import ControlSource
from dfcgs_codec.codec.motion.field import control_points
from dfcgs_codec.codec.residual.classes import nonzero_rows
from dfcgs_codec.codec.state.planes import SH_BANDS, FrameState, Plane
from dfcgs_codec.entropy.symbols import Groups, code_escaping, code_residuals
from dfcgs_codec.entropy.tables import NUM_SCALES, Shape
from dfcgs_codec.model.latent_model import HYPER_REACH, NUM_LATENTS, WIDTHS, LatentModel, PriorInputs
from dfcgs_codec.transform.control_points import control_cells
from dfcgs_codec.transform.normalisation import Normalisation, shifted
from dfcgs_codec.transform.rotation import ONE, normalise
from dfcgs_codec.transform.spreading import Spreading, spread_from

#: fraction bits of appearance, of colour refinements, and of motions
_APPEARANCE_BITS = 12
_REFINEMENT_BITS = 12
_MOTION_BITS = 16
#: fraction bits of a quaternion's change, beyond those of motions
_TURN_SHIFT = 8
#: log-scales and opacities are divided by 4
_QUARTER_BITS = 2
#: ln 2, 16 fraction bits, and what is left of them in a quarter with 12
_LN2, _LN2_SHIFT = 45426, 6
_TABLES = np.arange(NUM_SCALES, dtype=np.int64) + Shape.GAUSSIAN * NUM_SCALES


def appearance_of(frame: FrameState, units: UnitExponents, log2_size: int) -> Int64:
    """All attributes but the position, (N, 56), 12 fraction bits; scales against 2**log2_size scene units."""
    planes, quarter = frame.planes, _APPEARANCE_BITS - _QUARTER_BITS
    size = (log2_size * _LN2) >> _LN2_SHIFT
    colors = [planes[Attribute.SH_DC], *(planes[a] for a in SH_BANDS if a in planes)]
    columns = [
        shifted(planes[Attribute.SCALE].wide(), units.scale + quarter) - size,
        planes[Attribute.ROTATION].wide() >> _APPEARANCE_BITS,
        shifted(planes[Attribute.OPACITY].wide(), units.opacity + quarter),
        *(shifted(plane.wide(), units.color + _APPEARANCE_BITS) for plane in colors),
    ]
    found = np.concatenate(columns, axis=1)
    missing = np.zeros((len(found), WIDTHS["appearance"][0] - found.shape[1]), np.int64)
    return np.concatenate([found, missing], axis=1)


@dataclass(frozen=True, eq=False)
class LatentControl:
    """Where the scene of a GoF is, its control points and whom they move; found when asked for."""

    source: ControlSource

    @cached_property
    def normalisation(self) -> Normalisation:
        """By the positions of the I-frame."""
        return Normalisation.of(self.source.positions.wide())

    @cached_property
    def points(self) -> tuple[Int64, Int64]:
        """Cells (N, 3) of the Gaussians, and which of them are control points (n,)."""
        positions, control = self.source.positions.wide(), self.source.control
        cells = control_cells(positions, positions[len(positions) >> 1], control.shift)
        return cells, control_points(cells, control)

    def spreading(self, header: SpreadHeader) -> Spreading:
        """Over whom control points spread their motion; the last one is kept."""
        return _spreading(self, header)


@lru_cache(maxsize=2)
def _spreading(control: LatentControl, header: SpreadHeader) -> Spreading:
    return spread_from(*control.points, header.num_neighbours, header.decay_exponent)


@lru_cache(maxsize=2)
def latent_control(source: ControlSource) -> LatentControl:
    """That of a GoF, the same for all its frames."""
    return LatentControl(source)


class LatentReference:
    """What a P-frame is predicted from: the reference as the model sees it; computed when asked for."""

    def __init__(self, model: LatentModel, state: GofState, units: UnitExponents) -> None:
        self._state, self._units = state, units
        self._control = latent_control(state.control)
        self.model = model

    @property
    def normalisation(self) -> Normalisation:
        """That of the GoF."""
        return self._control.normalisation

    @property
    def rows(self) -> Int64:
        """Row (n,) of each control point."""
        return self._control.points[1]

    def prior(self, rows: Int64 | None = None) -> Int64:
        """Spatial-temporal prior (rows, 16) of some Gaussians, or of all."""
        frame = self._state.frame
        if rows is not None:
            frame = frame.take(rows)
        normalisation = self.normalisation
        normal = normalisation.of_positions(frame.planes[Attribute.POSITION].wide())
        appearance = appearance_of(frame, self._units, normalisation.exponent + self._units.position)
        return self.model.prior(PriorInputs(normal, appearance))

    def moved(self, header: LatentHeader, latents: Int64) -> FrameState:
        """The frame when control points spread the motion that `latents` (n, 16) stand for."""
        found = self.model.motions(latents)
        translations = shifted(found[:, :3], self.normalisation.exponent - _MOTION_BITS)
        motions = np.concatenate([translations, found[:, 3:] << _TURN_SHIFT], axis=1)
        return spread_over(motions, self._control.spreading(header.spread), self._state.frame)

    def refined(self, frame: FrameState) -> FrameState:
        """`frame`, predicted from the reference, with the model's changes of colour; it holds no floats."""
        bands = [attribute for attribute in SH_BANDS if attribute in frame.planes]
        if not bands:
            return frame if frame.verbatim is None else replace(frame, verbatim=None)
        changes = self.model.refinements(self.prior())
        changes = shifted(changes, -(_REFINEMENT_BITS + self._units.color))
        planes, start = dict(frame.planes), 0
        for attribute in bands:
            values = planes[attribute].wide()
            stop = start + values.shape[1]
            changed = np.clip(values + changes[:, start:stop], -STATE_LIMIT, STATE_LIMIT)
            planes[attribute] = Plane(changed)
            start = stop
        return replace(frame, planes=planes, verbatim=None)


def spread_over(motions: Int64, spreading: Spreading, reference: FrameState) -> FrameState:
    """The frame that `reference` becomes when control points spread their `motions` (n, 7).

    Columns: translation in grid units, change of the quaternion in 2**-24. All add what they receive (the
    paper's equation of motion compensation); nothing received changes no bit.
    """
    limited = np.clip(motions, -2 * STATE_LIMIT, 2 * STATE_LIMIT)
    received = spreading.received(limited, reference.num_gaussians)
    planes = dict(reference.planes)
    positions = reference.planes[Attribute.POSITION].wide() + received[:, :3]
    planes[Attribute.POSITION] = Plane(np.clip(positions, -STATE_LIMIT, STATE_LIMIT))
    rotations = reference.planes[Attribute.ROTATION].wide()
    changed = rotations + np.clip(received[:, 3:], -ONE, ONE)
    rows = np.flatnonzero(nonzero_rows(received[:, 3:]) & nonzero_rows(changed))
    if len(rows):
        rotations[rows] = normalise(changed[rows])
        planes[Attribute.ROTATION] = Plane(rotations)
    return replace(reference, planes=planes, verbatim=None)


def code_hyper(coder: SymbolCoder, hyper: Int64 | None, model: LatentModel, count: int) -> Int64:
    """Hyperprior latents (count, 16), each column with its own frozen table (factorised model)."""
    groups = Groups(np.tile(np.arange(NUM_LATENTS), count), NUM_LATENTS)
    given = None if hyper is None else hyper.ravel()
    return code_escaping(coder, given, groups, model.hyper_models, HYPER_REACH).reshape(count, NUM_LATENTS)


def code_latents(coder: SymbolCoder, symbols: Int64 | None, indices: Int64) -> Int64:
    """Symbols of motion latents (n, 16), each with the Gaussian table that `indices` (n, 16) name."""
    given = None if symbols is None else symbols.ravel()
    coded = code_residuals(coder, given, indices.ravel().astype(np.uint8), _TABLES)
    return coded.reshape(indices.shape)
