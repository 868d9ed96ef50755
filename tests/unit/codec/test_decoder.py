"""Files that are well framed and still wrong, and the places where decoding may begin and end."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions, decode_sequence
from dfcgs_codec.bitstream.constants import ChunkType, IntraKind
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.errors import (
    BitstreamError,
    CorruptBitstream,
    InputError,
    LimitExceeded,
    ModelMismatch,
    VerificationError,
)
from dfcgs_codec.model.registry import installed
from lab.chunks import Chunk, join_chunks, split_chunks
from lab.options import encoder_options
from lab.small_clouds import all_changing, make_cloud, same_cloud, travelling
from tests.helpers import encode, frame_hashes


@pytest.fixture(scope="module")
def chunks(tmp_path_factory: pytest.TempPathFactory) -> list[Chunk]:
    """I P I, of 40 Gaussians; SEQUENCE_HEADER ENCODER_INFO INTRA INTER RESIDUAL INTRA."""
    path = tmp_path_factory.mktemp("decoder") / "a.dgs"
    encode(all_changing(make_cloud(40, 1), 3), path, EncoderOptions(gof_size=2))
    found = split_chunks(path.read_bytes())
    assert [c.chunk_type for c in found] == [0x01, 0x81, 0x10, 0x20, 0x24, 0x10]
    assert join_chunks(found) == path.read_bytes()
    return found


@pytest.fixture(scope="module")
def six_frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("decoder") / "six.dgs"
    encode(travelling(make_cloud(30), 6, 0.01), path, EncoderOptions(gof_size=3))
    return path


def decode(chunks: Sequence[Chunk], *, check: bool = True, index: bytes | None = None) -> list[int]:
    data = join_chunks(chunks, index=index)
    return [frame.index for frame in SequenceDecoder(BytesIO(data), check=check).frames()]


def with_payload(chunks: list[Chunk], at: int, payload: bytes) -> list[Chunk]:
    return [*chunks[:at], replace(chunks[at], payload=payload), *chunks[at + 1 :]]


# --- order of chunks ----------------------------------------------------------------------------------


def test_the_file_as_it_is(chunks: list[Chunk]) -> None:
    assert decode(chunks) == [0, 1, 2]


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ((0, 1, 3, 4, 5), "P-frame without an I-frame"),
        ((0, 1, 2, 3, 5), "RESIDUAL"),
        ((0, 1, 2, 3), "lacks its"),
        ((0, 1, 2, 4, 5), "stands where it may not"),
        ((0, 1, 2, 3, 4), "fewer frames"),
        ((0, 1, 2, 5), "frame 1 is missing"),
        ((0, 1), "fewer frames"),
        ((0, 1, 2, 2, 3, 4, 5), "frame 1 is missing"),
        ((0, 1, 2, 3, 4, 0, 5), "stands where it may not"),
        ((0, 1, 5, 2, 3, 4), "frame 0 is missing"),
        ((0, 1, 2, 3, 4, 5, 5), "missing|more frames"),
    ],
)
def test_chunks_missing_or_out_of_order(chunks: list[Chunk], kept: tuple[int, ...], words: str) -> None:
    with pytest.raises(CorruptBitstream, match=words):
        decode([chunks[i] for i in kept], index=b"")


def test_a_frame_beyond_the_header_is_refused(chunks: list[Chunk]) -> None:
    with pytest.raises(CorruptBitstream, match="more frames"):
        decode([*chunks, replace(chunks[2], frame_index=3)])


def test_encoder_information_is_not_needed(chunks: list[Chunk]) -> None:
    assert decode([chunks[0], *chunks[2:]]) == [0, 1, 2]


def test_a_residual_belongs_to_its_frame(chunks: list[Chunk]) -> None:
    wrong = [*chunks[:4], replace(chunks[4], frame_index=2), chunks[5]]
    with pytest.raises(CorruptBitstream, match="RESIDUAL"):
        decode(wrong)


def test_chunks_of_another_profile_are_refused(chunks: list[Chunk]) -> None:
    with pytest.raises(CorruptBitstream, match="may not"):
        decode([*chunks[:5], Chunk(ChunkType.HYPERPRIOR, 1, b"stray"), chunks[5]])


def test_an_unknown_ancillary_chunk_changes_nothing(chunks: list[Chunk]) -> None:
    assert decode([*chunks[:2], Chunk(0xC0, 0, b"note"), *chunks[2:]]) == [0, 1, 2]


def test_a_known_chunk_without_frames_is_checked_too(chunks: list[Chunk]) -> None:
    data = bytearray(join_chunks(chunks))
    data[data.index(b"dfcgs-codec")] ^= 1
    with pytest.raises(CorruptBitstream, match="checksum"):
        list(SequenceDecoder(BytesIO(bytes(data))).frames())


# --- payloads -----------------------------------------------------------------------------------------


def test_a_wrong_hash_is_a_verification_error_unless_unchecked(chunks: list[Chunk]) -> None:
    payload = bytearray(chunks[2].payload)
    payload[0] ^= 1
    wrong = with_payload(chunks, 2, bytes(payload))
    with pytest.raises(VerificationError, match="frame 0 decodes to other values"):
        decode(wrong)
    assert decode(wrong, check=False) == [0, 1, 2]


@pytest.mark.parametrize("at", [2, 3, 4])
def test_a_payload_with_a_byte_too_many_is_corrupt(chunks: list[Chunk], at: int) -> None:
    with pytest.raises(CorruptBitstream):
        decode(with_payload(chunks, at, chunks[at].payload + b"\x00"))


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("at", [2, 3, 4])
def test_every_shorter_payload_is_corrupt(chunks: list[Chunk], at: int, every: int) -> None:
    for length in range(0, len(chunks[at].payload), every):
        with pytest.raises(CorruptBitstream):
            decode(with_payload(chunks, at, chunks[at].payload[:length]))


@pytest.mark.parametrize("most", [150, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", [IntraKind.CODED, IntraKind.PLY])
def test_damage_behind_a_right_checksum_is_refused_or_decodes(
    tmp_path: Path, kind: IntraKind, most: int
) -> None:
    """Nothing but BitstreamError and VerificationError comes out, whatever a byte is changed to."""
    frames = all_changing(make_cloud(3 if kind == IntraKind.PLY else 33), 2)
    encode(frames, tmp_path / "a.dgs", encoder_options(intra=kind))
    chunks = split_chunks((tmp_path / "a.dgs").read_bytes())
    refused = tried = 0
    for at, chunk in enumerate(chunks):
        for position in range(0, len(chunk.payload), 1 + len(chunk.payload) // most | 1):
            wrong = bytearray(chunk.payload)
            wrong[position] ^= (0x01, 0x80, 0x24, 0xFF)[position % 4]
            refused, tried = refused + 1, tried + 1
            with contextlib.suppress(BitstreamError, VerificationError):
                decode(with_payload(chunks, at, bytes(wrong)))
                refused -= 1
    assert refused > tried // 2


@pytest.mark.parametrize("exponent", [-10, 0, 60])
def test_an_opacity_grid_too_coarse_for_its_knots_is_refused(chunks: list[Chunk], exponent: int) -> None:
    header = SequenceHeader.read(ByteReader(chunks[0].payload))
    writer = ByteWriter()
    replace(header, unit_exponents=replace(header.unit_exponents, opacity=exponent)).write(writer)
    with pytest.raises(LimitExceeded):
        decode(with_payload(chunks, 0, writer.getvalue()))


def test_models_that_are_not_there_are_named(chunks: list[Chunk]) -> None:
    named = b"\x06main-1" + installed("main-1").digest[:8]
    assert chunks[0].payload.endswith(named)
    payload = bytearray(chunks[0].payload[: -len(named)] + b"\0")
    payload[1] = 1
    with pytest.raises(ModelMismatch, match="''"):
        decode(with_payload(chunks, 0, bytes(payload) + bytes(8)))
    with pytest.raises(ModelMismatch, match="future"):
        decode(with_payload(chunks, 0, bytes(payload[:-1]) + b"\x06future" + bytes(8)))
    main = bytes(payload[:1]) + b"\0" + bytes(payload[2:-1])
    with pytest.raises(ModelMismatch, match="future"):
        decode(with_payload(chunks, 0, main + b"\x06future" + bytes(8)))
    with pytest.raises(ModelMismatch, match="hash 0000"):
        decode(with_payload(chunks, 0, main + b"\x06main-1" + bytes(8)))
    with pytest.raises(ModelMismatch, match="not one of profile MAIN"):
        decode(with_payload(chunks, 0, main + b"\x07paper-1" + installed("paper-1").digest[:8]))
    with pytest.raises(ModelMismatch, match="not one of profile PAPER"):
        decode(with_payload(chunks, 0, bytes(payload[:-1]) + named))


# --- ranges of frames ---------------------------------------------------------------------------------


def test_a_range_is_the_slice_of_all_frames(six_frames: Path) -> None:
    whole = list(decode_sequence(six_frames))
    wrong = []
    for start, stop in itertools.product(range(7), [*range(8), None]):
        part = list(decode_sequence(six_frames, start, stop))
        if [f.index for f in part] != list(range(6))[start:stop]:
            wrong.append((start, stop))
        for frame in part:
            assert frame.state.hash() == whole[frame.index].state.hash()
            assert same_cloud(frame.cloud(), whole[frame.index].cloud())
    assert wrong == []


@pytest.mark.parametrize(("start", "stop"), [(-1, None), (0, -1), (-3, -1)])
def test_negative_frames_are_no_crash(six_frames: Path, start: int, stop: int | None) -> None:
    try:
        found = [frame.index for frame in decode_sequence(six_frames, start, stop)]
    except (InputError, BitstreamError):
        return
    assert found == list(range(6))[start:stop]


def test_seeking_reads_no_earlier_gof(six_frames: Path, tmp_path: Path) -> None:
    data = bytearray(six_frames.read_bytes())
    with six_frames.open("rb") as file:
        first, second = (e.offset for e in SequenceDecoder(file).container.index().entries)
    data[first + 40 : second] = bytes(second - first - 40)
    (tmp_path / "half.dgs").write_bytes(data)
    found = list(decode_sequence(tmp_path / "half.dgs", 3))
    assert [f.state.hash() for f in found] == frame_hashes(six_frames)[3:]


@pytest.mark.parametrize("payload", [b"\x01\x03\x10", b"\x02\x01\x4b\x02\x50", b"\x00"])
def test_a_wrong_index_is_refused_when_it_is_used(chunks: list[Chunk], payload: bytes) -> None:
    decoder = SequenceDecoder(BytesIO(join_chunks(chunks, index=payload)))
    with pytest.raises(BitstreamError):
        list(decoder.frames(1, 2))


def test_an_index_that_names_another_frame_is_refused(chunks: list[Chunk]) -> None:
    """GoFs of one and of two frames instead of two and one."""
    right = join_chunks(chunks)
    entries = SequenceDecoder(BytesIO(right)).container.index().entries
    first, second = entries[0].offset, entries[1].offset - entries[0].offset
    gap = bytes((second & 0x7F | 0x80, second >> 7)) if second > 127 else bytes((second,))
    wrong = bytes((2, 1, first, 2)) + gap
    with pytest.raises(CorruptBitstream):
        list(SequenceDecoder(BytesIO(join_chunks(chunks, index=wrong))).frames(1, 2))


def test_frame_numbers_are_those_of_the_input(six_frames: Path) -> None:
    assert [frame.number for frame in decode_sequence(six_frames)] == list(range(6))
