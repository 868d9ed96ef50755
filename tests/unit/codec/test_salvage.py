from __future__ import annotations

import random
from io import BytesIO
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions
from dfcgs_codec.bitstream.container import ContainerReader
from dfcgs_codec.codec.salvage import salvage
from dfcgs_codec.errors import CorruptBitstream, NotADgsFile, TruncatedBitstream
from tests.helpers import all_changing, encode, frame_hashes, make_cloud


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
        assert f"begins with frame {3 * (frame // 3)}" in losses[0]


def test_a_wrong_length_ends_the_search(path: Path) -> None:
    data = bytearray(path.read_bytes())
    at = starts(bytes(data))[3]
    data[at + 2 : at + 4] = b"\xff\x7f"
    indices, _, losses = rescue(bytes(data))
    assert indices[:3] == [0, 1, 2]
    assert losses


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
