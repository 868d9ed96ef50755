from __future__ import annotations

import threading

import pytest

from dfcgs_codec.transform.threads import beside


def test_the_caller_goes_on() -> None:
    gate = threading.Event()
    waiting = beside(lambda: gate.wait(10))
    # only a caller that was not held up opens it
    gate.set()
    assert waiting.result(20)


def test_errors_reach_the_caller() -> None:
    def fail() -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        beside(fail).result()
