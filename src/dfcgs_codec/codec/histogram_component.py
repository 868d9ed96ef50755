"""A component coded by its own histogram (spec section 11.3).

For values whose distribution no scale table fits: peaks, gaps, flat tops. The histogram depends on where
an earlier component lies; it is written to the stream.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.codec.side_information import NUM_HISTOGRAM_CONTEXTS, HistogramLayout
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.entropy.symbols import Groups, code_bits, code_with_models


def code_with_histogram(
    coder: SymbolCoder, target: Int64 | None, guide: Int64 | None, coding: tuple[HistogramLayout, int]
) -> Int64:
    """Code `target` (N,) int64 (None when reading); `coding` is (layout, N); returns it."""
    layout, count = coding
    offset = None if target is None else target - layout.minimum
    symbols = None if offset is None else offset >> layout.low_bits
    contexts = layout.contexts(guide, count)
    groups = Groups(contexts, NUM_HISTOGRAM_CONTEXTS)
    known = np.zeros(0, np.int64) if symbols is None else symbols
    if layout.size > 1:
        models = coder.histograms(groups.used, NUM_HISTOGRAM_CONTEXTS, layout.size, lambda: (known, contexts))
        coded = code_with_models(coder, symbols, groups, models)
    else:
        coded = np.zeros(count, np.int64)
    low = None if offset is None else offset & ((1 << layout.low_bits) - 1)
    bits = code_bits(coder, low, layout.low_bits, count)
    return ((coded << layout.low_bits) | bits) + layout.minimum
