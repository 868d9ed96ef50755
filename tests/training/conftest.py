"""Networks this small are fastest on one thread, and equal to themselves on one only; fitting needs none."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


@pytest.fixture(scope="package", autouse=True)
def one_thread():
    if find_spec("torch") is None:
        yield
        return
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
