"""Which of the two implementations decodes: the C core where `wasmtime` is there, or numpy."""

from __future__ import annotations

import os
from functools import cache
from importlib.util import find_spec

from dfcgs_codec.errors import InputError

CORE, NUMPY = "core", "numpy"
ENGINES = (CORE, NUMPY)
#: the environment variable that names one where nobody else does
VARIABLE = "DFCGS_ENGINE"


@cache
def has_core() -> bool:
    """Whether the core can run here."""
    return find_spec("wasmtime") is not None


def chosen_engine(name: str | None = None) -> str:
    """The engine called `name`, or that of the environment, or the best there is; InputError for others."""
    wanted = name or os.environ.get(VARIABLE) or None
    if wanted is None:
        return CORE if has_core() else NUMPY
    if wanted not in ENGINES:
        raise InputError(f"engine {wanted!r} is unknown, expected one of {', '.join(ENGINES)}")
    if wanted == CORE and not has_core():
        raise InputError("engine core needs the package wasmtime, which is not installed")
    return wanted
