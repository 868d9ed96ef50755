from __future__ import annotations

import random
from io import BytesIO
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions
from dfcgs_codec.bitstream.constants import MAGIC, ChunkType
from dfcgs_codec.bitstream.container import ContainerReader, write_chunk
from dfcgs_codec.bitstream.frame_headers import IntraHeader, read_lengths
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.codec.frame.salvage import salvage
from dfcgs_codec.errors import CorruptBitstream, NotADgsFile, TruncatedBitstream
from lab.chunks import split_chunks
from lab.small_clouds import all_changing, make_cloud
from tests.helpers import ROOT, encode, frame_hashes

CONFORMANCE = ROOT / "tests" / "conformance" / "valid"


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three GoFs of three frames."""
    path = tmp_path_factory.mktemp("salvage") / "a.dgs"
    encode(all_changing(make_cloud(40), 9), path, EncoderOptions(gof_size=3))
    return path


def rescue(data: bytes) -> tuple[list[int], list[bytes], list[str]]:
    losses: list[str] = []
    frames = list(salvage(BytesIO(data), losses))
    return [f.index for f in frames], [f.state.hash() for f in frames], losses


def starts(data: bytes) -> list[int]:
    """Where the chunks of each frame begin."""
    found: dict[int, int] = {}
    for head in ContainerReader(BytesIO(data)).chunks():
        if head.chunk_type in (0x10, 0x20):
            found[head.frame_index] = head.offset
    return [found[i] for i in sorted(found)]


def test_a_whole_file_loses_nothing(path: Path) -> None:
    assert rescue(path.read_bytes()) == (list(range(9)), frame_hashes(path), [])


def test_a_truncated_file_keeps_every_whole_frame(path: Path) -> None:
    data, hashes = path.read_bytes(), frame_hashes(path)
    begin = [*starts(data), len(data)]
    for length in range(begin[0], len(data), 53):
        whole = max(i for i in range(10) if begin[i] <= length)
        indices, found, losses = rescue(data[:length])
        # the index and end chunks are lost before the last frame is
        assert indices == list(range(len(indices)))
        assert len(indices) >= min(whole, 8)
        assert found == hashes[: len(indices)]
        assert losses


def test_damage_costs_the_rest_of_its_gof_only(path: Path) -> None:
    data, hashes = path.read_bytes(), frame_hashes(path)
    for frame, offset in enumerate(starts(data)):
        wrong = bytearray(data)
        wrong[offset + 12] ^= 0x10
        indices, found, losses = rescue(bytes(wrong))
        lost = range(frame, 3 * (frame // 3) + 3)
        assert indices == [i for i in range(9) if i not in lost]
        assert found == [hashes[i] for i in indices]
        assert len(losses) == 1
        which = f"frame {frame}:" if len(lost) == 1 else f"frames {frame} to {lost[-1]}:"
        assert losses[0].startswith(which)
        assert "checksum" in losses[0]


def damaged(data: bytes, offset: int, change: bytes) -> bytes:
    return data[:offset] + change + data[offset + len(change) :]


#: what becomes of the first bytes of a frame's chunk: type, frame index, length
HEADS = {
    "type": b"\x33",
    "type of another frame": b"\x20",
    "type of none": b"\xb3",
    "frame index": b"\x10\x07",
    "length too large": b"\x10\x03\xff\x7f",
    "length a little too large": b"\x10\x03\xa0\x0b",
    "length too small": b"\x10\x03\x81\x01",
    "nothing right": b"\xff" * 30,
}


@pytest.mark.parametrize("has_index", [True, False])
@pytest.mark.parametrize("name", HEADS)
def test_a_damaged_head_costs_its_gof_only(path: Path, name: str, has_index: bool) -> None:
    data, hashes = path.read_bytes(), frame_hashes(path)
    wrong = damaged(data, starts(data)[3], HEADS[name])
    indices, found, losses = rescue(wrong if has_index else wrong[:-30])
    assert indices == [0, 1, 2, 6, 7, 8]
    assert found == [hashes[i] for i in indices]
    assert losses[0].startswith("frames 3 to 5: ")
    assert len(losses) == 1


def test_only_the_end_is_damaged(path: Path) -> None:
    data = path.read_bytes()
    for wrong in (data[:-3], damaged(data, len(data) - 20, b"oops"), data[:-15]):
        indices, _, losses = rescue(wrong)
        assert indices == list(range(9))
        assert losses[0].startswith("no frame, but: ")


def test_a_chunk_without_frames_costs_none(path: Path) -> None:
    data = path.read_bytes()
    at = data.index(b"dfcgs-codec")
    indices, _, losses = rescue(damaged(data, at, b"D"))
    assert indices == list(range(9))
    assert len(losses) == 1


def test_the_search_for_frames_is_bounded() -> None:
    """Bytes that look like ever new I-frames, each half as long as the file."""
    chunks = split_chunks((CONFORMANCE / "single_gaussian.dgs").read_bytes())
    sequence = SequenceHeader.read(ByteReader(chunks[0].payload))
    payload = next(c.payload for c in chunks if c.chunk_type == ChunkType.INTRA_FRAME)
    reader = ByteReader(payload)
    header = IntraHeader.read(reader, sequence)
    lengths = list(read_lengths(reader, header.streams(sequence.sh_degree)).values())
    rest = 100_000
    writer = ByteWriter()
    header.write(writer)
    for length in [*lengths[:-1], rest - sum(lengths[:-1])]:
        writer.uvarint(length)
    head = ByteWriter()
    head.raw(bytes([ChunkType.INTRA_FRAME, 0]))
    head.uvarint(len(writer) + rest)
    decoy = head.getvalue() + writer.getvalue()
    start = MAGIC + write_chunk(ChunkType.SEQUENCE_HEADER, 0, chunks[0].payload) + b"\x33"
    indices, _, losses = rescue(start + decoy * (2 * rest // len(decoy)))
    assert indices == []
    assert "looks like" in losses[0]


def test_without_a_header_nothing_can_be_done(path: Path) -> None:
    data = path.read_bytes()
    with pytest.raises(TruncatedBitstream):
        rescue(data[:12])
    with pytest.raises(NotADgsFile):
        rescue(b"oops" + data)
    wrong = bytearray(data)
    wrong[15] ^= 1
    with pytest.raises(CorruptBitstream):
        rescue(bytes(wrong))


@pytest.mark.parametrize("seed", range(5))
def test_random_damage_never_yields_a_wrong_frame(path: Path, seed: int) -> None:
    rng = random.Random(seed)
    data, hashes = bytearray(path.read_bytes()), frame_hashes(path)
    for _ in range(4):
        data[rng.randrange(40, len(data))] ^= rng.randrange(1, 256)
    indices, found, _ = rescue(bytes(data))
    assert found == [hashes[i] for i in indices]
