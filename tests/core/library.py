"""The sources of the core as a native library, whose procedures take numpy arrays and integers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

CORE = Path(__file__).resolve().parents[2] / "core"
_COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
_FLAGS = ("-std=c11", "-O2", "-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off")

OK, CORRUPT = 0, 1


class Arena(ctypes.Structure):
    """`dfcgs_arena`; keeps its memory alive."""

    _fields_ = (
        ("base", ctypes.c_void_p),
        ("size", ctypes.c_size_t),
        ("used", ctypes.c_size_t),
        ("peak", ctypes.c_size_t),
    )

    @staticmethod
    def of(size: int) -> Arena:
        """One of `size` bytes."""
        memory = (ctypes.c_byte * (size + 16))()
        base = -(-ctypes.addressof(memory) // 16) * 16
        arena = Arena(base, size, 0, 0)
        arena.memory = memory
        return arena


@cache
def _library() -> ctypes.CDLL:
    if _COMPILER is None:
        pytest.skip("no C compiler")
    folder = Path(tempfile.mkdtemp(prefix="dfcgs-core-"))
    path = folder / "core.so"
    sources = sorted(str(source) for source in CORE.glob("*.c"))
    subprocess.run([_COMPILER, *_FLAGS, "-o", str(path), *sources, "-lm"], check=True)
    library = ctypes.CDLL(str(path))
    shutil.rmtree(folder)
    return library


def _argument(value: Any) -> Any:
    if value is None:
        return ctypes.c_void_p(None)
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        return ctypes.c_void_p(value.ctypes.data)
    if isinstance(value, ctypes.Structure):
        return ctypes.byref(value)
    return value if isinstance(value, ctypes.c_size_t) else ctypes.c_int32(value)


def call(name: str, *arguments: Any) -> int:
    """Result of `dfcgs_<name>`; arrays are passed as they lie, integers as 32 bits, None as NULL."""
    return int(getattr(_library(), f"dfcgs_{name}")(*map(_argument, arguments)))


def int32(values: Any) -> np.ndarray[Any, np.dtype[np.int32]]:
    """As the core takes them; no value may change."""
    wide = np.asarray(values)
    narrow = np.ascontiguousarray(wide, np.int32)
    assert np.array_equal(narrow, wide)
    return narrow
