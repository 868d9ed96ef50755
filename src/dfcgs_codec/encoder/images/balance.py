"""Steps of attributes in proportion to what they show: bits go where they mend most of the image.

Steps that a QP alone gives are those of a typical scene. How much a step of opacity, of a turn or of colour
shows differs from scene to scene by a factor of two, so the first frame's Gaussians are quantised, attribute
by attribute, and looked at (`sensitivity`). Then a bit is to buy the same in each attribute, and the sum of
all errors is to stay what it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import AnyArray, Float64, Int64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.encoder.images.sensitivity import ImageError
from dfcgs_codec.encoder.images.splats import Splats, alpha_of, deviations, rotation_matrices
from dfcgs_codec.encoder.residual.quantise import faintest
from dfcgs_codec.transform.companding import compress_thinness, expand, expand_thinness
from dfcgs_codec.transform.rotation import ONE, STEREO_ONE

#: steps change by no more octaves
_MOST_OCTAVES = 1.2
#: how far what a bit is worth is looked for, and how closely
_WORTH_OCTAVES = 64.0
_HALVINGS = 48
#: what shows nothing counts as this share of all errors
_LEAST_SHARE = 1e-6
#: Gaussians that the cost of a bit is estimated from
_MOST_ROWS = 20_000
#: radians to a unit of a stereographic vector, where it is short
_RADIANS = 4.0
#: symbols smaller than this have no bits worth an estimate
_LEAST_SYMBOL = 0.03


@dataclass(frozen=True)
class Quantised:
    """Gaussians and their steps: what can be drawn of them, with one attribute quantised or none.

    `planes` (N, C) and `steps` (N, 1), of axes and turns about them (N, 3), in grid units; symbols below
    `zero_bin` are zero; axis 2 is companded over `thin_octaves`.
    """

    planes: Mapping[Attribute, Int64]
    steps: Mapping[Attribute, Float64]
    units: UnitExponents
    zero_bin: float
    thin_octaves: int = 0

    def splats(self, rows: Int64) -> Splats:
        """Some of them as they are."""
        return self._splats({attribute: plane[rows] for attribute, plane in self.planes.items()})

    def shapes(self, rows: Int64) -> Splats:
        """The same without colours."""
        planes = {a: self.planes[a][rows] for a in self.planes if a < Attribute.SH_DC}
        return self._splats(planes)

    def draw(self, rows: Int64) -> tuple[Splats, dict[Attribute, Splats]]:
        """Some of them as they are, and by attribute with that one quantised."""
        planes = {attribute: plane[rows] for attribute, plane in self.planes.items()}
        splats = self._splats(planes)
        return splats, {a: self._changed(splats, planes, a, rows) for a in planes}

    def quantised(self, rows: Int64) -> Splats:
        """Some of them with all attributes quantised."""
        splats, changed = self.draw(rows)
        colours = sum(
            (there.colours - splats.colours for a, there in changed.items() if a >= Attribute.SH_DC),
            splats.colours,
        )
        return Splats(
            changed[Attribute.POSITION].positions,
            changed[Attribute.ROTATION].axes,
            changed[Attribute.SCALE].deviations,
            changed[Attribute.OPACITY].alpha,
            colours,
        )

    def _splats(self, planes: Mapping[Attribute, Int64]) -> Splats:
        return Splats(
            self.positions(planes[Attribute.POSITION]),
            rotation_matrices(planes[Attribute.ROTATION] / ONE),
            deviations(planes[Attribute.SCALE] * 2.0**self.units.scale),
            self._alpha(planes[Attribute.OPACITY]),
            self._colours(planes),
        )

    def sizes(self, attribute: Attribute, rows: Int64) -> Float64:
        """Mean magnitude (rows,) of a Gaussian's symbols, predicted by no more than the median."""
        values = self.planes[attribute][rows]
        sizes: Float64 = np.abs((values - np.median(values, axis=0)) / self.steps[attribute][rows]).mean(1)
        return sizes

    def _changed(
        self, splats: Splats, planes: Mapping[Attribute, Int64], attribute: Attribute, rows: Int64
    ) -> Splats:
        random = np.random.default_rng(int(attribute))
        steps = self.steps[attribute][rows]
        if attribute >= Attribute.SH_DC:
            errors = self._colour_errors(attribute, planes[attribute] / steps, random) * steps
            return replace(splats, colours=self._colours({**planes, attribute: planes[attribute] + errors}))
        errors = (random.random((len(rows), 3)) - 0.5) * steps
        if attribute == Attribute.POSITION:
            return replace(splats, positions=splats.positions + errors * 2.0**self.units.position)
        if attribute == Attribute.SCALE:
            scales = planes[attribute] + (random.random((len(rows), 3)) - 0.5) * steps[:, :1]
            if self.thin_octaves:
                scales[:, 2] = scales[:, 1] - self._thinness(planes[attribute], errors[:, 0])
            return replace(splats, deviations=deviations(scales * 2.0**self.units.scale))
        if attribute == Attribute.OPACITY:
            # what is not to be seen is coded so that it is not
            faint = planes[attribute] < faintest(self.units.opacity)
            values = planes[attribute] + np.where(faint, 0, np.rint(errors[:, :1])).astype(np.int64)
            return replace(splats, alpha=self._alpha(values))
        vectors = errors * (_RADIANS / 2 / STEREO_ONE)
        turns = rotation_matrices(np.concatenate([np.ones((len(rows), 1)), vectors], axis=1))
        return replace(splats, axes=np.einsum("nij,njk->nik", splats.axes, turns))

    def _colour_errors(self, attribute: Attribute, values: Float64, random: np.random.Generator) -> Float64:
        """In steps, as are `values` (rows, C): about predictions that are off by what values vary there."""
        if attribute == Attribute.SH_DC:
            return random.random(values.shape) - 0.5
        size = np.minimum(np.abs(values).mean(axis=1, keepdims=True), 1.0)
        symbols = values + (random.random(values.shape) - 0.5) * size
        errors: Float64 = np.where(np.abs(symbols) < self.zero_bin, 0.0, np.rint(symbols)) - symbols
        return errors

    def _thinness(self, scales: Int64, errors: Float64) -> Int64:
        """How much longer axis 1 is than axis 2, (rows,), with `errors` (rows,) where it is companded."""
        exponent, octaves = self.units.scale, self.thin_octaves
        companded = compress_thinness(scales[:, 1] - scales[:, 2], exponent, octaves)
        return expand_thinness(companded + np.rint(errors).astype(np.int64), exponent, octaves)

    def positions(self, values: Int64) -> Float64:
        """Scene units, the origin included."""
        units = self.units
        return np.asarray((values + np.array(units.origin)) * 2.0**units.position, np.float64)

    def _alpha(self, values: Int64) -> Float64:
        return alpha_of(expand(values[:, 0], self.units.opacity) * 2.0**self.units.opacity)

    def _colours(self, planes: Mapping[Attribute, AnyArray]) -> Float64:
        of_colour = [planes[a] for a in sorted(planes) if a >= Attribute.SH_DC]
        if not of_colour:
            return np.zeros((len(planes[Attribute.POSITION]), 3, 0))
        joined = np.concatenate(of_colour, axis=1)
        return joined.reshape(len(joined), joined.shape[1] // 3, 3).transpose(0, 2, 1) * 2.0**self.units.color


def _entropy(size: Float64, zero_bin: float) -> Float64:
    """Bits of Laplace symbols of mean magnitudes `size`, in steps."""
    tail, zero = np.exp(-1.0 / size), -np.expm1(-zero_bin / size)

    def binary(p: Float64) -> Float64:
        return -(p * np.log2(np.maximum(p, 1e-300)) + (1 - p) * np.log2(np.maximum(1 - p, 1e-300)))

    bits: Float64 = binary(zero) + (1 - zero) * (1 + binary(tail) / (1 - tail))
    return bits


def bits_per_octave(sizes: Float64, zero_bin: float) -> float:
    """Bits that a symbol takes less when its step doubles: mean over `sizes` (rows,), 1 for large ones."""
    sizes = np.clip(sizes, _LEAST_SYMBOL, 64.0)
    quarter = 2.0**0.25
    slopes = 2 * (_entropy(sizes * quarter, zero_bin) - _entropy(sizes / quarter, zero_bin))
    return float(np.clip(slopes, 0.0, 1.0).mean())


def _octaves(error: ImageError, worth: float) -> float:
    """Octaves by which steps are to be coarser, so that half of the slope on logarithms is `worth`."""
    half = 0.5 * error.swaps
    # smooth x^2 + half x = worth, where steps are x times as large
    return float(np.log2(2.0 * worth / (half + np.sqrt(half * half + 4.0 * error.smooth * worth))))


def total_error(errors: Mapping[Attribute, ImageError], octaves: Mapping[Attribute, float]) -> float:
    """All errors with steps coarser by so many octaves."""
    return sum(error.at(octaves.get(attribute, 0.0)) for attribute, error in errors.items())


def _largest(total: Callable[[float], float], limit: float, low: float, high: float) -> float:
    """The largest exponent from `low` to `high` at which `total`, which rises, is not above `limit`."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if total(middle) > limit else (middle, high)
    return low


def balanced_octaves(
    errors: Mapping[Attribute, ImageError], quantised: Quantised, fixed: frozenset[Attribute]
) -> dict[Attribute, float]:
    """Octaves by which steps of attributes are to be coarser; those of `fixed` ones are as they are.

    `errors` are those that each attribute makes with the steps it has (`image_errors`); none where nothing
    can be seen.
    """
    least = _LEAST_SHARE * sum(error.at(0.0) for error in errors.values())
    if least <= 0.0:
        return {}
    count = len(quantised.planes[Attribute.POSITION])
    rows = np.arange(0, count, max(1, count // _MOST_ROWS))
    bits, shown = {}, {}
    for attribute in sorted(errors.keys() - fixed):
        columns = 3 if attribute == Attribute.ROTATION else STATE_COLUMNS[attribute]
        share = 1.0
        if attribute > Attribute.SH_DC:
            share = bits_per_octave(quantised.sizes(attribute, rows), quantised.zero_bin)
        bits[attribute] = max(columns * share, _LEAST_SHARE)
        error = errors[attribute]
        shown[attribute] = replace(error, smooth=max(error.smooth, least))

    def octaves(worth: float) -> dict[Attribute, float]:
        return {a: _octaves(error, bits[a] * 2.0**worth) for a, error in shown.items()}

    # what a bit is worth: as much as keeps the sum of all errors
    limit = total_error(shown, {})
    middle = float(np.log2(limit))
    worth = _largest(
        lambda w: total_error(shown, octaves(w)), limit, middle - _WORTH_OCTAVES, middle + _WORTH_OCTAVES
    )
    return {a: float(np.clip(o, -_MOST_OCTAVES, _MOST_OCTAVES)) for a, o in octaves(worth).items()}


def no_worse(
    octaves: Mapping[Attribute, float], errors: Mapping[Attribute, ImageError], limit: float
) -> dict[Attribute, float]:
    """The same octaves, all less by as much as keeps the sum of all errors below `limit`, if that is one."""

    def changed(more: float) -> dict[Attribute, float]:
        return {attribute: octave + more for attribute, octave in octaves.items()}

    # with a limit of 0 nothing could be seen: no step is fine enough
    if limit <= 0.0 or total_error(errors, octaves) <= limit:
        return dict(octaves)
    return changed(_largest(lambda more: total_error(errors, changed(more)), limit, -_WORTH_OCTAVES, 0.0))
