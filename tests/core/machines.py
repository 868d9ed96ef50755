"""Procedures of the core, called with numpy arrays and integers: built for this machine, and the module."""

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

from dfcgs_codec.core.module import Instance

CORE = Path(__file__).resolve().parents[2] / "core"
_COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
#: those that are pure procedures on arrays
_SOURCES = (
    *("core", "lod", "companding", "visibility", "reconstruct", "network", "prior"),
    *("nearness", "farthest", "gather", "motion", "turns", "output", "hash"),
)
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
    sources = [str(CORE / f"{name}.c") for name in _SOURCES]
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


class Native:
    """The sources as the compiler of this machine builds them."""

    def call(self, name: str, *arguments: Any) -> int:
        """See `call`."""
        return int(getattr(_library(), f"dfcgs_{name}")(*map(_argument, arguments)))


class Module:
    """The module of the package; each array keeps its place in memory, and is copied there and back."""

    def __init__(self) -> None:
        self._instance = Instance()
        self._places: dict[int, tuple[int, Any]] = {}

    def _place(self, value: Any, size: int) -> int:
        if id(value) not in self._places:
            self._places[id(value)] = self._instance.grow(max(size, 1)), value
        return self._places[id(value)][0]

    def _address(self, value: Any) -> int:
        if value is None or isinstance(value, int | np.integer):
            return int(value or 0)
        if isinstance(value, np.ndarray):
            place = self._place(value, value.nbytes)
            self._instance.view_at(place, value.dtype, value.shape)[...] = value
            return place
        if not isinstance(value, Arena):
            pytest.skip("holds addresses of this machine")
        record = self._place(value, 16 + value.size)
        self._instance.view_at(record, "<u4", (4,))[:] = record + 16, value.size, value.used, value.peak
        return record

    def call(self, name: str, *arguments: Any) -> int:
        """See `call`."""
        given = [self._address(value) for value in arguments]
        try:
            result = self._instance.call(f"dfcgs_{name}", *given)
        except KeyError:
            pytest.skip("no function of the module")
        for value, place in zip(arguments, given, strict=True):
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value[...] = self._instance.view_at(place, value.dtype, value.shape)
            elif isinstance(value, Arena):
                value.used = int(self._instance.view_at(place, "<u4", (4,))[2])
        return result


def use(machine: Native | Module) -> None:
    """What `call` calls from now on."""
    _used[:] = [machine]


_used: list[Native | Module] = [Native()]


def call(name: str, *arguments: Any) -> int:
    """Result of `dfcgs_<name>`; arrays are passed as they lie, integers as 32 bits, None as NULL."""
    return _used[0].call(name, *arguments)


def int32(values: Any) -> np.ndarray[Any, np.dtype[np.int32]]:
    """As the core takes them; no value may change."""
    wide = np.asarray(values)
    narrow = np.ascontiguousarray(wide, np.int32)
    assert np.array_equal(narrow, wide)
    return narrow
