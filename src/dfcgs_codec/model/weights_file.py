"""Files of frozen weights: `<model_id>.weights`, known by the SHA-256 of their bytes (spec section 16.1).

For each array in rising order of its name: name, type and shape as ASCII text, each ended by a zero byte;
then its values, the last index running fastest, little-endian.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Integers
from dfcgs_codec.model.layers import Layer, LayerError, Network

Arrays = Mapping[str, Integers]

ENDING = ".weights"
_TYPES = ("|i1", "<i2", "<i4", "<i8")


def file_of(arrays: Arrays) -> bytes:
    """The bytes of the file that holds `arrays`."""
    parts = []
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        texts = (name, array.dtype.str.replace("=", "<"), repr(tuple(array.shape)))
        parts += [text.encode() + b"\0" for text in texts]
        parts.append(array.tobytes())
    return b"".join(parts)


def digest_of(arrays: Arrays) -> bytes:
    """SHA-256 of the file."""
    return hashlib.sha256(file_of(arrays)).digest()


def _arrays_of(data: bytes) -> Iterator[tuple[str, Integers]]:
    start = 0
    while start < len(data):
        texts = []
        for _ in range(3):
            end = data.index(0, start)
            texts.append(data[start:end].decode("ascii"))
            start = end + 1
        name, kind, shape = texts
        if kind not in _TYPES:
            raise ValueError(f"{name} has the unknown type {kind}")
        sizes = [int(size) for size in re.findall(r"\d+", shape)]
        values = np.frombuffer(data, kind, math.prod(sizes), start)
        start += values.nbytes
        yield name, values.reshape(sizes).astype(values.dtype.newbyteorder("="))


def read_arrays(path: Path) -> dict[str, Integers]:
    """The arrays of a file; LayerError where it is none."""
    try:
        return dict(_arrays_of(path.read_bytes()))
    except ValueError as error:
        raise LayerError(f"{path} is not a file of weights: {error}") from error


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write a file."""
    path.write_bytes(file_of(arrays))


def network_of(arrays: Arrays, name: str) -> Network | None:
    """The network `name`, or None where the file has none."""
    layers: list[Layer] = []
    while f"{name}.{len(layers)}.weight" in arrays:
        prefix = f"{name}.{len(layers)}"
        parts = [arrays.get(f"{prefix}.{part}") for part in ("weight", "bias", "scale")]
        if any(part is None for part in parts):
            raise LayerError(f"{prefix} lacks an array")
        layers.append(Layer.of(*parts))  # type: ignore[arg-type]
    return Network(tuple(layers)) if layers else None
