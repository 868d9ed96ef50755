"""Which of the two implementations decodes: the C core where `wasmtime` runs, or numpy."""

from __future__ import annotations

import os
from functools import cache

from dfcgs_codec.errors import InputError

CORE, NUMPY = "core", "numpy"
ENGINES = (CORE, NUMPY)
#: the environment variable that names one where nobody else does
VARIABLE = "DFCGS_ENGINE"


@cache
def has_core() -> bool:
    """Whether the core can run here; imports `wasmtime`, a tenth of a second."""
    try:
        import wasmtime  # noqa: F401
    except (ImportError, OSError, RuntimeError):  # not installed, or not for this machine
        return False
    return True


def wants_core(name: str | None = None) -> bool:
    """Whether the engine called `name`, that of the environment, or the best there is, is the core.

    InputError for names of no engine, and for one that cannot run here.
    """
    wanted = name or os.environ.get(VARIABLE)
    if wanted and wanted not in ENGINES:
        raise InputError(f"--engine {wanted}: expected one of {', '.join(ENGINES)}")
    if wanted == CORE and not has_core():
        raise InputError("--engine core: the package wasmtime cannot be imported")
    return wanted != NUMPY and has_core()
