"""How large numbers are: sums of rows, and logarithms as inputs of the prior (spec section 12.3)."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int64, UInt8

_LOG_LIMIT = (1 << 24) - 1
#: what is or is not
PRESENT = 64
#: running sums and memory count 16ths of symbols
MEMORY_BITS = 4


def row_sums(values: Int64) -> Int64:
    """Sum of each row of `values` (N, C)."""
    total = values[:, 0].copy()
    for column in range(1, values.shape[1]):
        total += values[:, column]
    return total


def log_of(values: Int64) -> UInt8:
    """Eighths of octaves of integers >= 0: 0 for 0, 8 for 1, 16 for 2, 199 at most; lines between octaves."""
    limited = np.minimum(values, _LOG_LIMIT).astype(np.float32)
    # the exponent and the first three bits of the mantissa
    logs = (limited.view(np.int32) >> 20) - (126 << 3)
    found: UInt8 = np.maximum(logs, 0).astype(np.uint8)
    return found
