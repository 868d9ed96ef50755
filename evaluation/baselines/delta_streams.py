"""One attribute of a frame as zigzag byte planes in a frame of zstd, and the reader of such a file.

u8 form (0 all zero, 1 values, 2 differences along the order); unless 0: u32 bytes, zstd frame
"""

from __future__ import annotations

import struct

import numpy as np
import zstandard

from dfcgs_codec.array_types import Int64
from evaluation.baselines.byte_planes import pack, unpack

REQUIREMENT = "zstandard==0.25.0"
_LEVEL = 19
_ZERO, _VALUES, _ALONG = 0, 1, 2


def _dictionary(before: Int64 | None) -> zstandard.ZstdCompressionDict | None:
    """The same attribute of the frame before, where zstd may look for what repeats."""
    if before is None:
        return None
    return zstandard.ZstdCompressionDict(pack(before), dict_type=zstandard.DICT_TYPE_RAWCONTENT)


def attribute_bytes(values: Int64, *, try_along: bool = False, before: Int64 | None = None) -> bytes:
    """Integers (N, C) as they are or, if to be tried and smaller, as differences along the order.

    `before` (M, C) is what the decoder has of the frame before, if it is to be used.
    """
    if not values.any():
        return bytes([_ZERO])
    size = values.nbytes + (0 if before is None else before.nbytes)
    parameters = zstandard.ZstdCompressionParameters.from_level(_LEVEL, source_size=size)
    compressor = zstandard.ZstdCompressor(dict_data=_dictionary(before), compression_params=parameters)
    forms = {_VALUES: values}
    if try_along:
        forms[_ALONG] = np.diff(values, axis=0, prepend=np.zeros((1, values.shape[1]), np.int64))
    coded = {form: compressor.compress(pack(v)) for form, v in forms.items()}
    best = min(coded, key=lambda form: len(coded[form]))
    return struct.pack("<BI", best, len(coded[best])) + coded[best]


class Reader:
    """Walks through the bytes of a file."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def fields(self, layout: struct.Struct) -> tuple[int, ...]:
        """The next numbers."""
        self._at += layout.size
        return layout.unpack_from(self._data, self._at - layout.size)

    def attribute(self, count: int, columns: int, before: Int64 | None = None) -> Int64:
        """The integers (`count`, `columns`) of `attribute_bytes`."""
        (form,) = self.fields(struct.Struct("<B"))
        if form == _ZERO:
            return np.zeros((count, columns), np.int64)
        (length,) = self.fields(struct.Struct("<I"))
        self._at += length
        data = self._data[self._at - length : self._at]
        data = zstandard.ZstdDecompressor(dict_data=_dictionary(before)).decompress(data)
        values = unpack(data, count, columns)
        return np.cumsum(values, axis=0) if form == _ALONG else values
