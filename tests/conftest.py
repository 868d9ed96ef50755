"""Settings of the whole suite: Hypothesis is deterministic, and slow machines do not fail it."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from dfcgs_codec.spelling import command_line

# as on the command line, and numpy is not loaded yet: more threads than one would only spin
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("suite")


@pytest.fixture(autouse=True)
def messages_as_written() -> Iterator[None]:
    """Tests look for messages as the source has them; those of Python's names put another in its place."""
    with command_line():
        yield
