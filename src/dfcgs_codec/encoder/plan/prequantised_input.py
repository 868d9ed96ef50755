"""Values that another tool has quantised: kept as they are where that is smaller than coding them anew.

Multiples of a power of two are told by looking. Coded in steps of just that size they come back without any
error, for the bits that they hold; in finer steps each would cost bits that say nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dfcgs_codec.array_types import Float32
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation, exponents_of
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import FrameSource

#: lattices looked for: 1, 1/2, 1/4 and so on
_FINEST_LOG2 = 12
#: so many of the values lie on the lattice at least (SPZ clamps some beside it), and so many are not zero
_SHARE, _NOT_ZERO = 0.99, 0.01
#: most inputs are told from lattices by so many values
_LOOKED_AT = 2000
#: values that are neither 0 nor 1 nor -1 times the step, at least
_FEWEST = 8
#: octaves, in the mean of the columns, by which lattices may be finer than the steps of I-frames: for
#: the bits more all error of these columns is gone. Measured where both ways are equal
_MEAN_OCTAVES = -0.4
#: and in each attribute
_LEAST_OCTAVES = -1.5


@np.errstate(over="ignore")
def lattice_log2(values: Float32) -> int | None:
    """log2, 0 to -12, of the largest power of two that nearly all `values` are multiples of, or None."""
    if np.count_nonzero(values) < _NOT_ZERO * values.size:
        return None
    some = np.ldexp(values.ravel()[:: max(1, values.size // _LOOKED_AT)], _FINEST_LOG2)
    if np.count_nonzero(some == np.rint(some)) < 0.9 * len(some):
        return None
    for exponent in range(_FINEST_LOG2 + 1):
        scaled = np.ldexp(values, exponent)
        whole = scaled == np.rint(scaled)
        if np.count_nonzero(whole) >= _SHARE * values.size:
            return None if np.count_nonzero(np.abs(scaled[whole]) > 1) < _FEWEST else -exponent
    return None


def _arrays(cloud: GaussianCloud) -> dict[Attribute, Float32]:
    """The values of attributes whose grids are multiples of powers of two, too."""
    arrays = {Attribute.POSITION: cloud.positions, Attribute.SCALE: cloud.scales}
    for band in range(1, cloud.sh_degree + 1):
        arrays[Attribute(Attribute.SH_DC + band)] = cloud.sh_rest[:, :, band * band - 1 : (band + 1) ** 2 - 1]
    return arrays


def lattices(cloud: GaussianCloud) -> dict[Attribute, int]:
    """`lattice_log2` by attribute, of those that have one."""
    found = {attribute: lattice_log2(values) for attribute, values in _arrays(cloud).items()}
    return {attribute: exponent for attribute, exponent in found.items() if exponent is not None}


def _kept(found: Mapping[Attribute, int], quantisation: Quantisation, sh_degree: int) -> dict[Attribute, int]:
    """Steps, in grid units, of attributes that are to be kept exactly; none where that does not pay."""
    exponents = exponents_of(quantisation.units)
    steps, octaves = {}, {}
    for attribute, exponent in found.items():
        log2 = exponent - exponents[attribute]
        octave = log2 - float(np.log2(quantisation.intra_steps[attribute]))
        if log2 >= 0 and octave >= _LEAST_OCTAVES and attribute not in quantisation.bounded:
            steps[attribute], octaves[attribute] = 1 << log2, octave
    # without spherical harmonics I-frames whose steps follow visibility are worth more
    bands = {Attribute(Attribute.SH_DC + band) for band in range(1, sh_degree + 1)}
    if not bands or bands - steps.keys():
        return {}
    columns = {attribute: STATE_COLUMNS[attribute] for attribute in steps}
    mean = sum(octaves[a] * count for a, count in columns.items()) / sum(columns.values())
    return steps if mean >= _MEAN_OCTAVES else {}


def keep_exactly(
    quantisation: Quantisation, source: FrameSource, found: Mapping[Attribute, int], sh_degree: int
) -> Quantisation:
    """With the input's own steps in attributes that it has quantised, where that pays.

    `found`: `lattices` of the first frame of `source`; the middle and the last one are looked at, too.
    """
    steps = _kept(found, quantisation, sh_degree)
    if not steps:
        return quantisation
    last = len(source.numbers) - 1
    for index in {last // 2, last} - {0}:
        others = lattices(source.read(index)[0])
        if any(others.get(attribute, -_FINEST_LOG2 - 1) < found[attribute] for attribute in steps):
            return quantisation
    names = ", ".join(f"{a.name} ({2.0 ** found[a]:g})" for a in sorted(steps))
    note = f"the input has quantised {names}: such values are kept as they are"
    return quantisation.keeping(steps, note)
