"""Section 16.1: files of models."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from tests.spec_decoder.basics import ROOT, ModelMismatch, Row, require

if TYPE_CHECKING:
    from tests.spec_decoder.basics import ROOT, Matrix
    from tests.spec_decoder.headers import Sequence


class Array(NamedTuple):
    """An array of integers: `|i1`, `<i2`, `<i4` or `<i8`; values with the last index running fastest."""

    dtype: str
    shape: tuple[int, ...]
    values: Row


Models = Mapping[str, Mapping[str, Array | tuple[str, tuple[int, ...], Row]]]

WEIGHTS = ROOT / "src" / "dfcgs_codec" / "model" / "weights"
#: 16.1: formats of `struct`
INTEGERS = {"|i1": "b", "<i2": "h", "<i4": "i", "<i8": "q"}


def read_model(data: bytes) -> dict[str, Array]:
    """16.1: a model from the bytes of its file."""
    arrays, place = {}, 0
    while place < len(data):
        texts = []
        for _ in range(3):
            end = data.index(0, place)
            texts.append(data[place:end].decode("ascii"))
            place = end + 1
        name, dtype, sizes = texts
        require(dtype in INTEGERS)
        shape = tuple(int(size) for size in sizes.strip("()").split(",") if size)
        layout = f"<{math.prod(shape)}{INTEGERS[dtype]}"
        arrays[name] = Array(dtype, shape, list(struct.unpack_from(layout, data, place)))
        place += struct.calcsize(layout)
    return arrays


@cache
def published() -> dict[str, dict[str, Array]]:
    """The models that belong to the specification, by id."""
    return {path.stem: read_model(path.read_bytes()) for path in sorted(WEIGHTS.glob("*.weights"))}


def model_hash(arrays: Mapping[str, Array]) -> bytes:
    """16.1; the file has its first 8 bytes."""
    whole = hashlib.sha256()
    for name in sorted(arrays, key=str.encode):
        dtype, shape, values = arrays[name]
        whole.update(name.encode() + b"\0" + dtype.encode() + b"\0" + str(tuple(shape)).encode() + b"\0")
        whole.update(struct.pack(f"<{len(values)}{INTEGERS[dtype]}", *values))
    return whole.digest()


def rows_of(array: Array) -> Matrix:
    """The last index along a row, all others as one."""
    columns = array.shape[-1]
    return [array.values[i : i + columns] for i in range(0, len(array.values), columns)]


def find_model(sequence: Sequence, models: Models, networks: tuple[str, ...]) -> dict[str, Array]:
    """A model of the profile has `networks`."""
    if sequence.model_id not in models:
        raise ModelMismatch
    arrays = {name: Array(*array) for name, array in models[sequence.model_id].items()}
    if model_hash(arrays)[:8] != sequence.model_hash:
        raise ModelMismatch
    if not all(f"{name}.0.weight" in arrays for name in networks):
        raise ModelMismatch
    return arrays
