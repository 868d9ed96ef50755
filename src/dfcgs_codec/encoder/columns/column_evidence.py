"""What an encoder looks at to choose how a column is predicted: all in steps, neighbours as in the input."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.codec.columns.coder import AnyReal, ColumnFacts

#: rows that weights are fitted to
_MOST_ROWS = 24_000


class ResidualsInSteps:
    """Residuals of the columns before in steps, and their magnitudes; known ones are not scaled twice."""

    def __init__(self) -> None:
        self._steps: Int64 | None = None
        self._residuals: list[Int64] = []
        self.values: list[AnyReal] = []
        self.magnitudes: list[AnyReal] = []

    def look(self, facts: ColumnFacts, part: slice) -> None:
        """Those of the rows `part`, for a column of the same stream as the last one."""
        if self._steps is not facts.steps or self._residuals is not facts.residuals:
            self._steps, self._residuals, self.values, self.magnitudes = facts.steps, facts.residuals, [], []
        for residual in facts.residuals[len(self.values) :]:
            found = residual[part] / facts.steps[part]
            self.values.append(found)
            self.magnitudes.append(np.abs(found))


class ColumnEvidence:
    """Features and goals of the weights of a column around `center`."""

    def __init__(self, facts: ColumnFacts, center: int, before: ResidualsInSteps) -> None:
        # a fit looks at no more rows than that anyway
        part = slice(None, None, max(1, len(facts.values) // _MOST_ROWS))
        mean = np.full(len(facts.values), float(center))
        deviation = np.zeros(len(facts.values))
        for level in facts.lod.levels:
            found = level.statistics(facts.values)
            mean[level.rows], deviation[level.rows] = found[0] / 256, found[1] / 256
        steps = facts.steps[part]
        before.look(facts, part)
        self._before = before
        self._mean: Float64 = (mean[part] - center) / steps
        self._deviation: Float64 = deviation[part] / steps
        self._values: Float64 = (facts.values[part] - center) / steps

    def of_values(self) -> tuple[list[AnyReal], Float64]:
        """Features and goal of the value's weights."""
        return [self._mean, *self._before.values], self._values

    def of_sizes(self, weights: Int64) -> tuple[list[AnyReal], Float64]:
        """Features and goal of the size's weights, where the value has `weights`."""
        features, goal = self.of_values()
        for feature, weight in zip(features, weights.tolist(), strict=True):
            if weight:
                goal = goal - feature * (weight / 256)
        own: list[AnyReal] = [self._deviation, np.ones(len(goal))]
        return own + self._before.magnitudes, np.abs(goal)
