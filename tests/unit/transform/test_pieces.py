from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.transform.pieces import pieces


@pytest.mark.parametrize("count", [0, 1, 8191, 8192, 8193, 50_000])
def test_pieces_are_all_rows_once_and_in_order(count: int) -> None:
    rows = np.arange(count)
    parts = [rows[part] for part in pieces(count)]
    assert np.array_equal(np.concatenate([rows[:0], *parts]), rows)
    assert all(0 < len(part) <= 8192 for part in parts)
    assert all(part.stop <= count for part in pieces(count))
