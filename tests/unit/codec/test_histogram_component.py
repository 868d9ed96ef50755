from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfcgs_codec.codec.histogram_component import code_with_histogram
from dfcgs_codec.codec.side_information import HistogramLayout
from dfcgs_codec.codec.symbols import SymbolCoder
from dfcgs_codec.encoder.estimation import fit_layout
from tests.helpers import check_walk


def check(target: np.ndarray, guide: np.ndarray | None, layout: HistogramLayout) -> int:
    def code(coder: SymbolCoder, writing: bool) -> np.ndarray:
        given = target if writing else None
        found = code_with_histogram(coder, given, guide, (layout, len(target)))
        assert np.array_equal(found, target)
        return found

    return check_walk(code, np.array_equal)


@given(st.data())
def test_any_layout(data: st.DataObject) -> None:
    low_bits, size = data.draw(st.integers(0, 12)), data.draw(st.integers(1, 60))
    minimum = data.draw(st.integers(-(2**28), 2**28))
    values = st.integers(minimum, minimum + (size << low_bits) - 1)
    target = data.draw(hnp.arrays(np.int64, st.integers(1, 50), elements=values))
    guides = hnp.arrays(np.int64, len(target), elements=st.integers(-(2**28), 2**28))
    guide = data.draw(st.none() | guides)
    layout = HistogramLayout(
        minimum, low_bits, size, data.draw(st.integers(-99, 99)), data.draw(st.integers(0, 29))
    )
    check(target, guide, layout)


@pytest.mark.parametrize("spread", [1, 50, 100_000])
@pytest.mark.parametrize("with_guide", [False, True])
def test_fitted_layouts(spread: int, with_guide: bool) -> None:
    rng = np.random.default_rng(0)
    target = rng.integers(-spread, spread + 1, 2000)
    guide = target + rng.integers(-5, 6, 2000) if with_guide else None
    layout = fit_layout(target, guide)
    assert layout is not None
    check(target, guide, layout)


def test_a_guide_helps_where_it_tells_the_value() -> None:
    rng = np.random.default_rng(0)
    guide = rng.choice([-40, 40], 4000)
    target = np.where(guide < 0, rng.integers(0, 4, 4000), rng.integers(12, 16, 4000))
    guided = check(target, guide, HistogramLayout(0, 0, 16, 0, 5))
    assert guided < 0.8 * check(target, None, HistogramLayout(0, 0, 16, 0, 0))


def test_contexts_are_steps_around_the_center() -> None:
    layout = HistogramLayout(0, 0, 2, 100, 3)
    guide = np.array([-(10**6), 67, 68, 99, 100, 107, 108, 10**6])
    assert layout.contexts(guide, 8).tolist() == [0, 0, 0, 3, 4, 4, 5, 7]
    assert layout.contexts(None, 3).tolist() == [0, 0, 0]
