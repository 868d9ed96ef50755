"""The writing direction of `SymbolCoder`: chooses from the evidence and writes the choice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dfcgs_codec.bitstream.constants import STATE_LIMIT
from dfcgs_codec.codec.histogram_component import code_with_histogram
from dfcgs_codec.codec.side_information import (
    HistogramLayout,
    code_layout,
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.codec.symbols import (
    HistogramEvidence,
    Int64,
    LayoutEvidence,
    ResidualEvidence,
    WeightEvidence,
)
from dfcgs_codec.encoder.estimation import (
    fit_histogram_levels,
    fit_layout,
    fit_tables,
    fit_weights,
)
from dfcgs_codec.entropy.coder import Model, RangeWriter, uniform


class SymbolWriter(RangeWriter):
    """Writes symbols and how they are coded."""

    def center(self, evidence: Callable[[], Int64]) -> int:
        """See SymbolCoder: the median."""
        return code_signed(self, int(np.median(evidence())), STATE_LIMIT)

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

    def layout(self, evidence: LayoutEvidence) -> HistogramLayout | None:
        """See SymbolCoder: both ways are tried."""
        values, guide, code_predicted = evidence()
        layout = fit_layout(values, guide)
        if layout is not None:
            predicted, counted = SymbolWriter(), SymbolWriter()
            code_predicted(predicted)
            code_with_histogram(counted, values, guide, (code_layout(counted, layout), len(values)))
            if len(predicted.getvalue()) <= len(counted.getvalue()):
                layout = None
        self.choice(2, lambda: int(layout is not None))
        return None if layout is None else code_layout(self, layout)
