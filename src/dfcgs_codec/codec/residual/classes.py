"""What a P-frame's residual says of each attribute: symbols, classes of its blocks (spec section 12.1)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dfcgs_codec.array_types import Bool, Int64
from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.codec.columns.magnitudes import MEMORY_BITS, row_sums

#: log2 of the Gaussians in a block
BLOCK_LOG2 = 6
NUM_DENSITIES = 4
DENSE = NUM_DENSITIES - 1
#: magnitude classes are half octaves of the mean magnitude, in quarters of a symbol
NUM_MAGNITUDES = 24
#: a quarter of running sums and memory fades with each frame
MEMORY_DECAY_LOG2 = 2
_MOST_RUNNING = 1 << 20


def nonzero_rows(values: Int64) -> Bool:
    """Whether each row of `values` (N, C) holds anything but zeros."""
    # column by column: numpy's any() over a short last axis is ten times slower
    found: Bool = values[:, 0] != 0
    for column in range(1, values.shape[1]):
        found |= values[:, column] != 0
    return found


@dataclass
class AttributeActivity:
    """What an attribute did in the previous frame; zeros after an I-frame and where it was absent.

    `symbols` int64 (N, C); `density` and `magnitude` int64 (blocks,). Where the prior may ask for it, what it
    did in the frames up to then: `memory` (N, C), `running` (N,); None is zeros.
    """

    symbols: Int64
    density: Int64
    magnitude: Int64
    memory: Int64 | None = None
    running: Int64 | None = None

    @staticmethod
    def none(num_gaussians: int, num_columns: int) -> AttributeActivity:
        """Nothing happened."""
        zero = np.zeros(num_blocks(num_gaussians), np.int64)
        return AttributeActivity(np.zeros((num_gaussians, num_columns), np.int64), zero, zero)

    def merged(self, num_births: int, source: Int64) -> AttributeActivity:
        """The same after Gaussians went and came, blocks forgotten.

        Row i of the result is row source[i] of these and of births, which have no symbols.
        """
        zero = np.zeros(num_blocks(len(source)), np.int64)

        def kept(values: Int64) -> Int64:
            births = np.zeros((num_births, *values.shape[1:]), np.int64)
            merged: Int64 = np.concatenate([values, births])[source]
            return merged

        memory = None if self.memory is None else kept(self.memory)
        running = None if self.running is None else kept(self.running)
        return AttributeActivity(kept(self.symbols), zero, zero, memory, running)

    def remembering(self, before: AttributeActivity) -> AttributeActivity:
        """The same with what it did in the frames up to now, `before` being that of the frame before."""
        change = -self.symbols << MEMORY_BITS
        size = np.minimum(row_sums(np.abs(self.symbols)), _MOST_RUNNING) << (MEMORY_BITS - MEMORY_DECAY_LOG2)
        if before.memory is not None and before.running is not None:
            change += before.memory
            size += before.running - (before.running >> MEMORY_DECAY_LOG2)
        memory = change - (change >> MEMORY_DECAY_LOG2)
        return replace(self, memory=memory, running=size)

    def significant(self) -> Bool:
        """Whether each Gaussian has a symbol other than zero."""
        return nonzero_rows(self.symbols)


@dataclass(frozen=True)
class InterSymbols:
    """What a P-frame carries: for each attribute present its symbols and block classes."""

    activity: dict[Attribute, AttributeActivity] = field(default_factory=dict)

    def merged(self, num_births: int, source: Int64) -> InterSymbols:
        """See AttributeActivity.merged."""
        return InterSymbols({a: x.merged(num_births, source) for a, x in self.activity.items()})


def num_inter_columns(attribute: Attribute) -> int:
    """Columns of an attribute's symbols in a P-frame; a turn has three."""
    return 3 if attribute == Attribute.ROTATION else STATE_COLUMNS[attribute]


def num_blocks(num_gaussians: int) -> int:
    """Blocks of 2**BLOCK_LOG2 Gaussians, the last one perhaps shorter."""
    return -(-num_gaussians >> BLOCK_LOG2)
