"""Files broken under right checksums: decoded, refused or found out, nothing else; `make fuzz` goes on."""

from __future__ import annotations

from collections import Counter
from functools import cache

import pytest

from tools import fuzz

SEEDS = 200
_BATCHES = 8


@cache
def _outcomes(batch: int) -> Counter[str]:
    """What became of the seeds of a batch; anything but frames and refusals comes out as itself."""
    counts: Counter[str] = Counter()
    for seed in range(batch, SEEDS, _BATCHES):
        counts.update(fuzz.run_seed(seed, fuzz.SMALL))
    return counts


@pytest.mark.parametrize("batch", range(_BATCHES))
def test_every_outcome_is_a_frame_or_a_refusal(batch: int) -> None:
    assert sum(_outcomes(batch).values()) == SEEDS // _BATCHES * len(fuzz.attempts(b""))


def test_the_mutator_reaches_all_of_the_decoder() -> None:
    """Most files are refused for what they say, not for their frame."""
    total = sum((_outcomes(batch) for batch in range(2)), Counter())
    assert set(total) >= {"decoded", "CorruptBitstream", "LimitExceeded", "VerificationError"}
    assert total["TruncatedBitstream"] < total["CorruptBitstream"]


def test_what_is_no_refusal_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "attempts", lambda data: (lambda: [][0],))
    with pytest.raises(IndexError):
        fuzz.run_seed(0, fuzz.SMALL)
