"""The reading direction of `SymbolCoder`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.columns.coder import (
    ColumnFacts,
    HistogramEvidence,
    ResidualEvidence,
    SplitEvidence,
    WeightEvidence,
)
from dfcgs_codec.codec.columns.side_information import (
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.entropy.coder import Model, RangeReader, uniform
from dfcgs_codec.entropy.tables import SPLIT_ALPHAS


class SymbolReader(RangeReader):
    """Reads what a SymbolWriter chose; evidence is never asked for."""

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """See SymbolCoder."""
        return code_weights(self, None, count)

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """See SymbolCoder."""
        return code_tables(self, None, num_contexts)

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """See SymbolCoder."""
        return histogram_models(self, None, used, num_contexts, size)

    def choice(self, size: int, evidence: Callable[[], int]) -> int:
        """See SymbolCoder."""
        return int(self.code(np.zeros(1, np.int64), uniform(size), 1)[0])

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """See SymbolCoder."""
        center = code_signed(self, None, STATE_LIMIT)
        return center, code_weights(self, None, 1 + num_before), code_weights(self, None, 2 + num_before)

    def split_bias(self, evidence: SplitEvidence) -> int:
        """See SymbolCoder."""
        return self.choice(len(SPLIT_ALPHAS), lambda: 0)
