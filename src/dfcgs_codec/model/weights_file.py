"""Files of frozen weights: `<model_id>.npz`, known by the SHA-256 of what is in it (spec section 16.1)."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Integers
from dfcgs_codec.model.layers import Layer, LayerError, Network

Arrays = Mapping[str, Integers]


def digest_of(arrays: Arrays) -> bytes:
    """SHA-256 over name, type, shape and little-endian bytes of each array, by name."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        for text in (name, array.dtype.str.replace("=", "<"), repr(tuple(array.shape))):
            digest.update(text.encode() + b"\0")
        digest.update(array.tobytes())
    return digest.digest()


def read_arrays(path: Path) -> dict[str, Integers]:
    """The arrays of a file; nothing in it is executed."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


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
