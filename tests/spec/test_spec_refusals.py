"""Chapter 19: what is refused, and how."""

from __future__ import annotations

import io
import re
import struct
import zlib

import pytest

from dfcgs_codec import BitstreamError, CorruptBitstream, VerificationError
from dfcgs_codec.bitstream import constants
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from tests.spec.checks import SPEC, bytes_of, example_block


def _patched(field: str, value: bytes, chunk: int = 0) -> bytes:
    """The worked example with the bytes of a field replaced and the checksum of its chunk made right.

    `chunk` counts the chunks that have such a field.
    """
    lines = example_block("file")
    data = bytearray(bytes_of(lines))
    starts = [int(line[:4], 16) for line in lines if line[55:].startswith("chunk_type")]
    ends = [int(line[:4], 16) for line in lines if line[55:].startswith("crc32")]
    places = [int(line[:4], 16) for line in lines if line[55:].split(" = ")[0] == field]
    place = places[chunk]
    data[place : place + len(value)] = value
    for start, end in zip(starts, ends, strict=True):
        if start <= place < end:
            data[end : end + 4] = struct.pack("<I", zlib.crc32(data[start:end]))
    return bytes(data)


_PLAIN = bytes_of(example_block("file"))

_CHUNKS = [int(line[:4], 16) for line in example_block("file") if line[55:].startswith("chunk_type")]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"PK" + _PLAIN, "not-a-dgs-file"),
        (b"glps" + _PLAIN, "not-a-dgs-file"),
        (_PLAIN[:5], "truncated"),
        (_PLAIN[: _CHUNKS[2] + 20], "truncated"),
        (_PLAIN[: _CHUNKS[-1]], "truncated"),
        (_PLAIN + b"\0", "corrupt"),
        (_PLAIN[: _CHUNKS[3]] + _PLAIN[_CHUNKS[-2] :], "corrupt"),
        (_PLAIN[: _CHUNKS[2]] + _PLAIN[_CHUNKS[3] :], "corrupt"),
        (_PLAIN[: _CHUNKS[4]] + _PLAIN[_CHUNKS[5] :], "corrupt"),
        (_PLAIN[: _CHUNKS[1]] + _PLAIN[8:], "corrupt"),
        (_PLAIN[:100] + b"!" + _PLAIN[101:], "corrupt"),
        (_patched("bitstream_version", bytes([constants.BITSTREAM_VERSION - 1])), "unsupported"),
        (_patched("bitstream_version", bytes([constants.BITSTREAM_VERSION + 1])), "unsupported"),
        (_patched("profile", b"\1"), "model-mismatch"),
        (_patched("profile", b"\2"), "unsupported"),
        (_patched("level", b"\0"), "unsupported"),
        (_patched("sh_degree", b"\4"), "limit"),
        (_patched("output_order", b"\3"), "unsupported"),
        (_patched("num_frames", b"\0"), "corrupt"),
        (_patched("num_frames", b"\3"), "corrupt"),
        (_patched("num_frames", b"\1"), "corrupt"),
        (_patched("frame_rate_denominator", b"\0"), "corrupt"),
        (_patched("run_length_minus_1", b"\0"), "corrupt"),
        (_patched("scale_exponent", bytes([61 * 2])), "limit"),
        (_patched("opacity_exponent", bytes([10 * 2 - 1])), "limit"),
        (_patched("model_id_length", b"\x7f"), "limit"),
        (_patched("model_id_length", b"\1"), "corrupt"),
        (_patched("chunk_type", b"\x22", 1), "corrupt"),
        (_patched("chunk_type", b"\x21", 1), "corrupt"),
        (_patched("chunk_type", b"\x23", 1), "corrupt"),
        (_patched("chunk_type", b"\x42", 1), "unsupported"),
        (_patched("frame_index", b"\1", 2), "corrupt"),
        (_patched("frame_hash", b"\0" * 16), "verification"),
        (_patched("frame_hash", b"\0" * 16, 1), "verification"),
        (_patched("intra_kind", b"\2"), "unsupported"),
        (_patched("num_gaussians", b"\0"), "corrupt"),
        (_patched("num_gaussians", b"\xff\xff\x7f"), "limit"),
        (_patched("has_permutation", b"\2"), "limit"),
        (_patched("has_permutation", b"\1"), "corrupt"),
        (_patched("control_spacing", b"\0"), "corrupt"),
        (_patched("control_shift", bytes([32])), "limit"),
        (_patched("sort_shift", bytes([32])), "limit"),
        (_patched("sort_bits", bytes([22])), "limit"),
        (_patched("has_excess", b"\2"), "limit"),
        (_patched("step of POSITION", b"\0"), "corrupt"),
        (_patched("step of SCALE", b"\x84\0"), "corrupt"),
        (_patched("stream_length of POSITION", b"\x05"), "corrupt"),
        (_patched("stream of POSITION", b"\xff" * 4), "corrupt"),
        (_patched("tools", b"\x81"), "unsupported"),
        (_patched("tools", b"\0"), "corrupt"),
        (_patched("tools", b"\1"), "corrupt"),
        (_patched("tools", b"\x0d"), "corrupt"),
        (_patched("tools", b"\x15"), "corrupt"),
        (_patched("visibility_level of POSITION", b"\x80\0"), "corrupt"),
        (_patched("translation_step", b"\0"), "corrupt"),
        (_patched("attribute_mask", b"\x35"), "corrupt"),
    ],
)
def test_refusals(data: bytes, code: str) -> None:
    with pytest.raises((BitstreamError, VerificationError)) as caught:
        list(SequenceDecoder(io.BytesIO(data)).frames())
    assert caught.value.code == code


def test_unknown_ancillary_chunks_are_skipped() -> None:
    data = _patched("chunk_type", b"\x90", 1)
    assert len(list(SequenceDecoder(io.BytesIO(data)).frames())) == 2
    damaged = bytearray(data)
    damaged[_CHUNKS[1] + 5] ^= 1
    with pytest.raises(CorruptBitstream):
        list(SequenceDecoder(io.BytesIO(bytes(damaged))).frames())


def test_text_names_every_error() -> None:
    codes = {kind.code: kind.__name__ for kind in BitstreamError.__subclasses__()}
    codes |= {VerificationError.code: VerificationError.__name__}
    text = SPEC[SPEC.index("## 19 ") : SPEC.index("## 20 ")]
    written = {code: name for name, code in re.findall(r"^\| `(\w+)` \| `([\w-]+)` \|", text, re.M)}
    assert written == codes
