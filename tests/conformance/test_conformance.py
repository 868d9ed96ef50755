"""The streams in `valid/` and `uncommon/` decode to what is written down, those in `faulty/` are refused.

The streams are written by `make golden` only.
"""

from __future__ import annotations

import hashlib
import json
from io import BytesIO
from pathlib import Path

import pytest

from dfcgs_codec import decode_sequence, errors
from dfcgs_codec.bitstream.constants import BITSTREAM_VERSION
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.errors import BitstreamError, TruncatedBitstream, VerificationError
from dfcgs_codec.ply import write_ply

FOLDER = Path(__file__).parent
EXPECTED = json.loads((FOLDER / "expected.json").read_text())
#: small enough that every prefix and many flips of it can be tried
SMALL = ("skipped_frames_sh0", "single_gaussian")


def read(name: str) -> bytes:
    return (FOLDER / "valid" / f"{name}.dgs").read_bytes()


def hashes(data: bytes) -> list[str]:
    return [frame.state.hash().hex() for frame in SequenceDecoder(BytesIO(data)).frames()]


def test_every_stream_is_expected() -> None:
    assert EXPECTED["bitstream_version"] == BITSTREAM_VERSION
    for kind in ("valid", "uncommon", "faulty"):
        assert {path.stem for path in (FOLDER / kind).glob("*.dgs")} == set(EXPECTED[kind])


@pytest.mark.parametrize(("kind", "name"), [(k, n) for k in ("valid", "uncommon") for n in EXPECTED[k]])
def test_valid(kind: str, name: str, tmp_path: Path) -> None:
    found: dict[str, list[str]] = {"frame_hashes": [], "ply_sha256": []}
    for frame in decode_sequence(FOLDER / kind / f"{name}.dgs"):
        write_ply(tmp_path / "frame.ply", frame.cloud())
        found["frame_hashes"].append(frame.state.hash().hex())
        found["ply_sha256"].append(hashlib.sha256((tmp_path / "frame.ply").read_bytes()).hexdigest())
    expected = EXPECTED[kind][name]
    assert found == {key: expected[key] for key in found}


@pytest.mark.parametrize("name", EXPECTED["faulty"])
def test_faulty(name: str) -> None:
    with pytest.raises(errors.DfcgsError) as caught:
        list(decode_sequence(FOLDER / "faulty" / f"{name}.dgs"))
    assert type(caught.value).__name__ == EXPECTED["faulty"][name]


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.timeout(120)
def test_every_prefix_is_truncated(name: str) -> None:
    data = read(name)
    for length in range(len(data)):
        with pytest.raises(TruncatedBitstream):
            hashes(data[:length])


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("pattern", [0x01, 0x80, 0xFF])
@pytest.mark.timeout(120)
def test_every_flipped_byte_is_refused_or_harmless(name: str, pattern: int) -> None:
    data = read(name)
    right = hashes(data)
    refused = 0
    for position in range(len(data)):
        flipped = bytearray(data)
        flipped[position] ^= pattern
        try:
            assert hashes(bytes(flipped)) == right
        except (BitstreamError, VerificationError):
            refused += 1
    # every byte is under the magic number or a checksum
    assert refused == len(data)
