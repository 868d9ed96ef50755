"""The module `core.wasm`: its functions, its memory, and the record that it leaves after each call."""

from __future__ import annotations

import atexit
import ctypes
import struct
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

MODULE = Path(__file__).with_name("core.wasm")
#: linear memory ends here
MOST_MEMORY = (1 << 32) - 1
#: it grows by these
_PAGE = 1 << 16
_NUM_ATTRIBUTES = 8
_NUM_ARRAYS = 6
_RECORD = struct.Struct("<4q2iI2IiI4i" + "8I8I3I6I")


@dataclass(frozen=True)
class Record:
    """What `info` of core/exports.c says: `planes`, `patterns` and `arrays` are addresses."""

    planes: tuple[int, ...]
    patterns: tuple[int, ...]
    arrays: tuple[int, ...]
    offset: int
    excess_value: int
    num_bytes: int
    peak: int
    status: int
    excess_kind: int
    message: int
    excess_frame: int
    excess_gaussians: int
    expects: int
    count: int
    num_attributes: int
    has_order: int
    has_patterns: int
    touched: int
    order: int
    escapes: int
    escape_bytes: int

    @staticmethod
    def of(data: bytes) -> Record:
        """From the bytes of the record."""
        values: tuple[int, ...] = _RECORD.unpack(data)
        single, rest = values[:15], values[15:]
        planes, rest = rest[:_NUM_ATTRIBUTES], rest[_NUM_ATTRIBUTES:]
        patterns, rest = rest[:_NUM_ATTRIBUTES], rest[_NUM_ATTRIBUTES:]
        named = dict(zip(_SINGLE, single, strict=True)) | dict(zip(_LAST, rest, strict=False))
        return Record(planes, patterns, rest[len(_LAST) :], **named)


_NAMES = [field.name for field in fields(Record)][3:]
#: what stands before the addresses of planes and patterns, and between these and those of arrays
_SINGLE, _LAST = _NAMES[:15], _NAMES[15:]


@cache
def _compiled() -> tuple[Any, Any]:
    """The engine and the module, compiled once a process: 30 ms."""
    # a slow import, and one that may fail: nobody but who decodes waits for it
    import wasmtime

    # at the very end of a process nothing is left that could close them
    atexit.register(_compiled.cache_clear)
    engine = wasmtime.Engine()
    return engine, wasmtime.Module.from_file(engine, str(MODULE))


class Instance:
    """One decoder with a memory of its own; functions of the module are called by name."""

    def __init__(self) -> None:
        import wasmtime

        engine, module = _compiled()
        self._store = wasmtime.Store(engine)
        self._exports = wasmtime.Instance(self._store, module, []).exports(self._store)
        self._memory: Any = self._exports["memory"]
        self._functions = cache(self._find)
        self._info = self.call("core_info")
        self.call("core_reset", MOST_MEMORY)

    def call(self, name: str, *arguments: int) -> int:
        """What the function returns, as an integer without sign; 0 where it returns nothing."""
        function, kinds = self._functions(name)
        given = [_signed(v) if kind == "i32" else v for v, kind in zip(arguments, kinds, strict=True)]
        return (function(self._store, *given) or 0) & MOST_MEMORY

    def _find(self, name: str) -> tuple[Any, list[str]]:
        """A function, and the types of its arguments."""
        function: Any = self._exports[name]
        return function, [str(kind) for kind in function.type(self._store).params]

    def grow(self, count: int) -> int:
        """Address of `count` bytes more, which are 0 and which no decoder has use of."""
        end: int = self._memory.data_len(self._store)
        self._memory.grow(self._store, -(-count // _PAGE))
        return end

    def record(self) -> Record:
        """The record after the last call."""
        return Record.of(self.bytes_at(self._info, _RECORD.size))

    def bytes_at(self, address: int, count: int) -> bytes:
        """A copy of `count` bytes."""
        return ctypes.string_at(self._base + address, count)

    def text_at(self, address: int) -> str:
        """Text that a zero byte ends."""
        return ctypes.string_at(self._base + address).decode() if address else ""

    def put(self, address: int, data: bytes) -> None:
        """Write bytes."""
        ctypes.memmove(self._base + address, data, len(data))

    def view_at(self, address: int, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """An array that lies in linear memory; of no use any more when that has grown, or is gone."""
        size = np.dtype(dtype).itemsize * int(np.prod(shape))
        data = (ctypes.c_ubyte * size).from_address(self._base + address)
        return np.ndarray(shape, dtype, memoryview(data).cast("B"))

    def array_at(self, address: int, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        """A copy of an array, that nobody may write to."""
        kind = np.dtype(dtype)
        data = self.bytes_at(address, kind.itemsize * int(np.prod(shape)))
        return np.frombuffer(data, kind).reshape(shape)

    @property
    def _base(self) -> int:
        """Where linear memory lies; it may move when it grows."""
        return ctypes.addressof(self._memory.data_ptr(self._store).contents)


def _signed(value: int) -> int:
    """As an argument of a function: 32 bits without a sign become 32 bits with one."""
    return value - (1 << 32) if 1 << 31 <= value < 1 << 32 else value
