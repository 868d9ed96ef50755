"""From QP, quality names and error bounds to quantiser steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.arguments import real
from dfcgs_codec.bitstream.constants import STATE_LIMIT, STEREO_FRACTION_BITS, Attribute, Precision
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import SH_BANDS
from dfcgs_codec.encoder.plan.position_grid import FINEST_EXPONENT, UNITS_PER_STEP_LOG2, plan_position_grid
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.companding import ALPHA_PER_UNIT

MIN_QP, MAX_QP = 0, 51
#: the step doubles every six QP
QP_PER_OCTAVE = 6
_DB_PER_OCTAVE = 6.02
#: below the reference QP the position's step halves faster: the error it causes shrinks with the 1.3rd power
#: of the step only, not with its square, because Gaussians that swap places in depth change the image at once
FINE_POSITION_QP_PER_OCTAVE = 4
#: PSNR of images of each quality name, dB
QUALITIES = {"low": 32.0, "medium": 37.0, "high": 42.0, "transparent": 50.0}
#: PSNRs that can be asked for, dB
MIN_PSNR, MAX_PSNR = 15.0, 70.0
#: where the search for the QP of a quality begins: scenes differ by 6 dB to both sides
TYPICAL_QP, _TYPICAL_PSNR = 28.0, 37.0
REFERENCE_QP = 22
#: steps at the reference QP and for REFERENCE_VALUES values to a Gaussian (SH degree 2); position: in typical
#: Gaussian sizes; rotation: stereographic. Their ratios give the last bit of each attribute about the same
#: effect in the rendered image (evaluation/experiments/i_frames/allocation.py)
REFERENCE_STEPS = {
    Attribute.POSITION: 1 / 8,
    Attribute.SCALE: 1 / 10,
    Attribute.ROTATION: 1 / 80,
    Attribute.OPACITY: 1 / 6,
    Attribute.SH_DC: 1 / 20,
    Attribute.SH_1: 1 / 16,
    Attribute.SH_2: 1 / 16,
    Attribute.SH_3: 1 / 16,
}
REFERENCE_VALUES = 37
#: octaves by which the steps of I-frames differ where they follow visibility: they are those of the Gaussians
#: that show most, and where cover and visibility are known the proportion that is best is another one
VISIBILITY_OCTAVES = {
    Attribute.POSITION: -0.5,
    Attribute.SCALE: -0.45,
    Attribute.ROTATION: -0.75,
    Attribute.OPACITY: -0.65,
    Attribute.SH_DC: -0.05,
    Attribute.SH_1: 0.0,
    Attribute.SH_2: 0.0,
    Attribute.SH_3: 0.0,
}
#: what `--bound` accepts, and its unit
BOUND_UNITS = {
    "position": "scene units, Euclidean",
    "rotation": "degrees",
    "scale": "natural logarithm",
    "alpha": "alpha, 0 to 1",
    "colour": "RGB, 0 to 1, at SH degree 0",
    "sh": "SH coefficient above degree 0",
}
#: RGB per unit of the SH degree 0 coefficient
SH_C0 = 0.28209479177387814
_COARSEST_EXPONENT = -12


def expected_qp(qp: float | None, quality: float) -> float:
    """`qp`, or the one that gives the `quality`, dB, in a typical scene."""
    typical = TYPICAL_QP - (quality - _TYPICAL_PSNR) * QP_PER_OCTAVE / _DB_PER_OCTAVE
    return min(max(typical, MIN_QP), MAX_QP) if qp is None else qp


@dataclass(frozen=True)
class Bound:
    """A maximum error of one attribute, in the unit of `BOUND_UNITS`."""

    attribute: str
    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", real("Bound.value", self.value, "a number above 0"))
        if not isinstance(self.attribute, str) or self.attribute not in BOUND_UNITS:
            known = ", ".join(f"{name} ({unit})" for name, unit in BOUND_UNITS.items())
            raise InputError(f"--bound {self.attribute}: unknown; known are {known}")
        if not (self.value > 0 and math.isfinite(self.value)):
            raise InputError(f"--bound {self.attribute}={self.value}: a bound is a number above 0")

    def steps(self) -> dict[Attribute, float]:
        """The attributes bounded and their largest steps (real units) that keep the bound."""
        value = self.value
        steps = {
            "position": {Attribute.POSITION: 2 * value / math.sqrt(3)},
            # 4 radians per unit of the stereographic vector at most, over half a cube's diagonal
            "rotation": {Attribute.ROTATION: math.radians(value) / (2 * math.sqrt(3))},
            "scale": {Attribute.SCALE: 2 * value},
            "alpha": {Attribute.OPACITY: 2 * value / ALPHA_PER_UNIT},
            "colour": {Attribute.SH_DC: 2 * value / SH_C0},
            "sh": dict.fromkeys(SH_BANDS, 2 * value),
        }
        return steps[self.attribute]


@dataclass(frozen=True)
class Quantisation:
    """Grids, steps in grid units, and the attributes whose error is bounded (no dead zone).

    `steps` are those of P-frames, `intra_steps` those of I-frames; `uniform`: attributes that have the same
    step in all Gaussians of an I-frame; `exact`: those whose steps are the ones that the input was quantised
    with.
    """

    units: UnitExponents
    steps: dict[Attribute, int]
    bounded: frozenset[Attribute]
    intra_steps: dict[Attribute, int]
    uniform: frozenset[Attribute]
    exact: frozenset[Attribute] = frozenset()
    notes: tuple[str, ...] = ()

    @property
    def follows_visibility(self) -> bool:
        """Whether steps of I-frames follow visibility, in any attribute."""
        return bool(self.intra_steps.keys() - self.uniform)

    def with_float32_positions(self) -> Quantisation:
        """For verbatim I-frames: positions that come out as float32, however the input has them."""
        return replace(self, units=replace(self.units, precision=Precision.FLOAT32))

    def finer(self, octaves: float) -> Quantisation:
        """With finer steps of P-frames, but for those that bounds or the input's own steps have set."""
        if octaves <= 0.0:
            return self
        free = self.steps.keys() - self.bounded - self.exact
        return replace(self, steps=_coarser(self.steps, dict.fromkeys(free, -octaves)))

    def keeping(self, steps: dict[Attribute, int], note: str) -> Quantisation:
        """With the `steps` that the input was quantised with, whose values are kept as they are."""
        exact = frozenset(steps)
        return replace(
            self,
            steps=self.steps | steps,
            intra_steps=self.intra_steps | steps,
            bounded=self.bounded | exact,
            uniform=self.uniform | exact,
            exact=exact,
            notes=(*self.notes, note),
        )

    def balanced(self, intra: Mapping[Attribute, float], inter: Mapping[Attribute, float]) -> Quantisation:
        """With steps of I-frames, and of P-frames, coarser by so many octaves."""
        return replace(self, steps=_coarser(self.steps, inter), intra_steps=_coarser(self.intra_steps, intra))


def _coarser(steps: Mapping[Attribute, int], octaves: Mapping[Attribute, float]) -> dict[Attribute, int]:
    return {
        a: min(max(1, round(step * 2.0 ** octaves.get(a, 0.0))), STATE_LIMIT) for a, step in steps.items()
    }


def typical_size(cloud: GaussianCloud) -> float:
    """Median over Gaussians of the geometric mean of their three standard deviations, scene units.

    An axis thinner than a sixteenth of the middle one counts as a sixteenth: discs are not small.
    """
    thin, middle, long = np.sort(cloud.scales, axis=1).T
    thin = np.maximum(thin, middle - math.log(16.0))
    return float(np.exp(np.clip(np.median((thin + middle + long) / 3.0), -60, 60)))


def _factor(attribute: Attribute, qp: float, first: GaussianCloud) -> float:
    """Step relative to the reference step.

    The errors of all values add up in the image: where a Gaussian has more of them, each must be smaller for
    the image to be as good, so that a quality means the same at every SH degree.
    """
    values = 3 + 3 + 3 + 1 + 3 + 3 * first.sh_rest.shape[2]
    fine_position = attribute == Attribute.POSITION and qp < REFERENCE_QP
    octave = FINE_POSITION_QP_PER_OCTAVE if fine_position else QP_PER_OCTAVE
    return math.sqrt(REFERENCE_VALUES / values) * math.exp2((qp - REFERENCE_QP) / octave)


def _spacing(attribute: Attribute, first: GaussianCloud) -> float:
    """Between float32 numbers as large as the largest of the attribute: what rounding the output may add."""
    arrays = {Attribute.SCALE: first.scales, Attribute.SH_DC: first.sh_dc}
    values = arrays.get(attribute, first.sh_rest if attribute > Attribute.SH_DC else None)
    if values is None or not values.size:
        return 0.0
    return float(np.spacing(np.abs(values).max()))


def _exponent(step: float) -> int:
    return max(FINEST_EXPONENT, min(_COARSEST_EXPONENT, math.floor(math.log2(step)) - UNITS_PER_STEP_LOG2))


def exponents_of(units: UnitExponents) -> dict[Attribute, int]:
    """log2 of the unit of each attribute's steps."""
    return {
        Attribute.POSITION: units.position,
        Attribute.SCALE: units.scale,
        Attribute.ROTATION: -STEREO_FRACTION_BITS,
        Attribute.OPACITY: units.opacity,
        **dict.fromkeys((Attribute.SH_DC, *SH_BANDS), units.color),
    }


def _limits(bounds: tuple[Bound, ...]) -> dict[Attribute, float]:
    """Largest step of each bounded attribute; of several bounds the tightest."""
    limits: dict[Attribute, float] = {}
    for bound in bounds:
        for attribute, step in bound.steps().items():
            limits[attribute] = min(step, limits.get(attribute, step))
    finest = 2.0 / (1 << STEREO_FRACTION_BITS)
    if limits.get(Attribute.ROTATION, finest) < finest:
        degrees = math.degrees(finest * 2 * math.sqrt(3))
        raise InputError(f"--bound rotation: the tightest that can be guaranteed is {degrees:.4f} degrees")
    return limits


def plan_quantisation(
    qp: float,
    bounds: tuple[Bound, ...],
    first: GaussianCloud,
    reference_steps: Mapping[Attribute, float] = REFERENCE_STEPS,
    *,
    visibility: bool = True,
) -> Quantisation:
    """Grids and steps for a sequence; `first` is its first frame, `reference_steps` those at REFERENCE_QP.

    `visibility`: whether steps of I-frames follow it, but for those that are bounded. Where grids that suit
    the steps do not reach all Gaussians of the frame, a note says what becomes of these.
    """
    real = {attribute: step * _factor(attribute, qp, first) for attribute, step in reference_steps.items()}
    real[Attribute.POSITION] *= typical_size(first)
    limits = {a: max(step - _spacing(a, first), step / 2) for a, step in _limits(bounds).items()}
    real |= limits
    colours = (Attribute.SH_DC, *SH_BANDS)
    grid = plan_position_grid(first.positions, real[Attribute.POSITION])
    units = UnitExponents(
        position=grid.exponent,
        scale=_exponent(real[Attribute.SCALE]),
        opacity=_exponent(real[Attribute.OPACITY]),
        color=_exponent(min(real[a] for a in colours)),
        origin=grid.origin,
        precision=Precision.FLOAT64 if first.positions.dtype == np.float64 else Precision.FLOAT32,
    )
    exponents = exponents_of(units)
    steps = {}
    for attribute, step in real.items():
        in_units = step / 2.0 ** exponents[attribute]
        # the input's own rounding to the grid takes one unit of a bounded step
        units_per_step = math.floor(in_units) - 1 if attribute in limits else round(in_units)
        steps[attribute] = min(max(1, units_per_step), STATE_LIMIT)
    uniform = frozenset(limits) if visibility else frozenset(steps)
    octaves = {a: octave for a, octave in VISIBILITY_OCTAVES.items() if a not in uniform}
    intra = _coarser(steps, octaves)
    return Quantisation(units, steps, frozenset(limits), intra, uniform, notes=grid.notes)
