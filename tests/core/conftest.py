"""Both ways in which procedures of the core are called."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dfcgs_codec.core.engine import has_core
from tests.core.machines import Module, Native, use


@pytest.fixture(params=["native", "module"])
def both_machines(request: pytest.FixtureRequest) -> Iterator[None]:
    """The sources built for this machine, then the module of the package where it can run."""
    if request.param == "module":
        if not has_core():
            pytest.skip("needs wasmtime")
        use(Module())
    yield
    use(Native())
