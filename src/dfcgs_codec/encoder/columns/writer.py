"""The writing direction of `SymbolCoder`: chooses from the evidence and writes the choice."""

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
from dfcgs_codec.encoder.columns.column_evidence import ColumnEvidence, ResidualsInSteps
from dfcgs_codec.encoder.columns.side_information import (
    fit_histogram_levels,
    fit_split_bias,
    fit_tables,
    fit_weights,
)
from dfcgs_codec.entropy.coder import Model, RangeWriter, uniform
from dfcgs_codec.entropy.tables import SPLIT_ALPHAS


class SymbolWriter(RangeWriter):
    """Writes symbols and how they are coded."""

    def __init__(self) -> None:
        super().__init__()
        self._before = ResidualsInSteps()

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """See SymbolCoder: least squares."""
        return code_weights(self, fit_weights(*evidence()), count)

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """See SymbolCoder: fewest bits."""
        residuals, contexts = evidence()
        return code_tables(self, fit_tables(residuals, contexts, num_contexts), num_contexts)

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """See SymbolCoder: the symbols' own frequencies."""
        symbols, contexts = evidence()
        levels = fit_histogram_levels(symbols, contexts, used, size)
        return histogram_models(self, levels, used, num_contexts, size)

    def choice(self, size: int, evidence: Callable[[], int]) -> int:
        """See SymbolCoder."""
        return int(self.code(np.array([evidence()], np.int64), uniform(size), 1)[0])

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """See SymbolCoder: the median, and least squares of values, then of the residuals' magnitudes."""
        facts = evidence()
        center = code_signed(self, int(np.median(facts.values)), STATE_LIMIT)
        found = ColumnEvidence(facts, center, self._before)
        weights = code_weights(self, fit_weights(*found.of_values()), 1 + num_before)
        sizes = fit_weights(*found.of_sizes(weights))
        return center, weights, code_weights(self, sizes, 2 + num_before)

    def split_bias(self, evidence: SplitEvidence) -> int:
        """See SymbolCoder: fewest bits."""
        return self.choice(len(SPLIT_ALPHAS), lambda: fit_split_bias(*evidence()))
