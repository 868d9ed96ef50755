"""What both sides know of a Gaussian before its residual, as inputs of the prior (spec section 12.3).

All inputs are integers from 0 to 255; magnitudes come as logarithms, eight to an octave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Bool, Int64, UInt8
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.codec.columns.magnitudes import PRESENT, log_of
from dfcgs_codec.codec.motion.followers import BLEND, Binding
from dfcgs_codec.model.context_model import INPUT_LIMIT

#: steps of small numbers: densities, columns left
SMALL = 16
#: efforts are in 1/16 of half octaves, four frames of them
EFFORT_SHIFT = 4
#: attributes whose symbols in the frame before others look at
BEFORE = (Attribute.POSITION, Attribute.ROTATION)
#: all bands of spherical harmonics but the first are one sort
SORTS = (
    Attribute.POSITION,
    Attribute.SCALE,
    Attribute.ROTATION,
    Attribute.OPACITY,
    Attribute.SH_DC,
    Attribute.SH_1,
)
#: of `gaussian_inputs`
NUM_GAUSSIAN_INPUTS = 5
#: of `common_inputs`
NUM_COMMON = NUM_GAUSSIAN_INPUTS + 7 + len(BEFORE) + len(SORTS)


def _small(values: Int64, factor: int) -> UInt8:
    found: UInt8 = np.minimum(values * factor, INPUT_LIMIT).astype(np.uint8)
    return found


def gaussian_inputs(binding: Binding | None, follows: Bool | None, count: int) -> UInt8:
    """How motion did by each Gaussian so far, (N, 5): efforts, whether the blend leads, whether it follows.

    Without a `binding` no motion was tried yet, without `follows` there is none in this frame.
    """
    inputs = np.zeros((count, NUM_GAUSSIAN_INPUTS), np.uint8)
    inputs[:, 3] = PRESENT
    if binding is not None:
        efforts = binding.efforts >> EFFORT_SHIFT
        least, most = efforts.min(axis=0), efforts.max(axis=0)
        inputs[:, 0] = np.minimum(efforts[binding.choice, np.arange(count)], INPUT_LIMIT)
        inputs[:, 1] = np.minimum(least, INPUT_LIMIT)
        inputs[:, 2] = np.minimum(most - least, INPUT_LIMIT)
        inputs[:, 3] = (binding.choice == BLEND) * PRESENT
    if follows is not None:
        inputs[:, 4] = follows * PRESENT
    return inputs


@dataclass(frozen=True)
class AttributeInputs:
    """What the inputs of an attribute's symbols are made of, all (rows,).

    `coarseness` in quarter octaves; magnitudes of its symbols `before` and `running`, of its `memory`;
    classes of the block; magnitudes of other attributes' symbols in the last frame (`earlier`).
    """

    attribute: Attribute
    coarseness: Int64 | None
    before: Int64
    running: Int64
    memory: Int64
    density_before: Int64
    density: Int64
    magnitude: Int64
    earlier: dict[Attribute, Int64]


def common_inputs(gaussians: UInt8, known: AttributeInputs) -> UInt8:
    """Inputs (rows, NUM_COMMON) of an attribute's symbols; `gaussians` (rows, 5) are those of all of them."""
    inputs = np.zeros((len(gaussians), NUM_COMMON), np.uint8)
    inputs[:, :NUM_GAUSSIAN_INPUTS] = gaussians
    at = NUM_GAUSSIAN_INPUTS
    if known.coarseness is not None:
        inputs[:, at] = _small(known.coarseness, 2)
    for column, values in enumerate((known.before, known.running, known.memory)):
        inputs[:, at + 1 + column] = log_of(values)
    inputs[:, at + 4] = _small(known.density_before, SMALL)
    inputs[:, at + 5] = _small(known.density, SMALL)
    inputs[:, at + 6] = _small(known.magnitude, 4)
    at += 7
    for column, attribute in enumerate(BEFORE):
        if attribute in known.earlier:
            inputs[:, at + column] = log_of(known.earlier[attribute])
    at += len(BEFORE)
    inputs[:, at + SORTS.index(min(known.attribute, Attribute.SH_1))] = PRESENT
    return inputs
