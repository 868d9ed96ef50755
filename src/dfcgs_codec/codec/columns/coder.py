"""The symbol coder that the walks are written over.

`SymbolCoder` has two implementations: `symbol_reader.SymbolReader` here and `SymbolWriter` in the
encoder. Where a stream says how its symbols are coded (tables, weights, histograms), the writer
chooses from the evidence that the walk offers, and the reader reads the choice. Evidence is a function,
so that a reader never computes it (spec section 11).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from dfcgs_codec.array_types import Float64, Int64, UInt8
from dfcgs_codec.entropy.coder import Model, RangeCoder
from dfcgs_codec.transform.lod import LevelsOfDetail

#: residuals (int64) and their contexts (uint8), of the same length
ResidualEvidence = Callable[[], tuple[Int64, UInt8]]
#: an encoder's floats will do where it only chooses
AnyReal = Int64 | Float64
#: features (a list of arrays) and the numbers they should predict
WeightEvidence = Callable[[], tuple[Sequence[AnyReal], AnyReal]]
#: symbols and their contexts
HistogramEvidence = Callable[[], tuple[Int64, UInt8]]
#: Gaussians of cells of the position tree, and how many of them lie in the lower half
SplitEvidence = Callable[[], tuple[Int64, Int64]]


class ColumnFacts(NamedTuple):
    """What a column is predicted from: `values` and `steps` (N,), `residuals` (N,) of columns before it."""

    values: Int64
    steps: Int64
    lod: LevelsOfDetail
    residuals: list[Int64]


class SymbolCoder(RangeCoder, Protocol):
    """A range coder that also settles, in its direction, how symbols are coded."""

    def weights(self, count: int, evidence: WeightEvidence) -> Int64:
        """`count` prediction weights, Q8."""

    def tables(self, num_contexts: int, evidence: ResidualEvidence) -> Int64:
        """A table (shape * 160 + scale) for each context."""

    def histograms(
        self, used: Int64, num_contexts: int, size: int, evidence: HistogramEvidence
    ) -> list[Model]:
        """A model of `size` symbols for each of `num_contexts` contexts; those not in `used` are flat."""

    def choice(self, size: int, evidence: Callable[[], int]) -> int:
        """A number 0 <= choice < size."""

    def predictor(self, num_before: int, evidence: Callable[[], ColumnFacts]) -> tuple[int, Int64, Int64]:
        """Center, weights of the value (1 + num_before,) and of its size (2 + num_before,), Q8."""

    def split_bias(self, evidence: SplitEvidence) -> int:
        """Bias of the models of how cells split."""
