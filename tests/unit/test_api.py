from __future__ import annotations

from pathlib import Path

import pytest

from dfcgs_codec import (
    EncoderOptions,
    GaussianCloud,
    InputError,
    NotADgsFile,
    VerificationError,
    decode_sequence,
    encode_sequence,
)
from dfcgs_codec.ply import PlyHeader
from dfcgs_codec.sequence import MemorySource, open_folder
from lab.chunks import join_chunks, split_chunks
from lab.small_clouds import drifting, make_cloud, still
from tests.helpers import QUICK, frame_hashes, write_frames

FRAMES = drifting(make_cloud(30, 1), 3)


class Generated:
    """A source of one's own: frames are made when they are asked for."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    @property
    def numbers(self) -> list[int]:
        return [0, 1, 2]

    @property
    def headers(self) -> list[PlyHeader]:
        return [PlyHeader(30, 1)] * 3

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        self.asked.append(index)
        return FRAMES[index], [f"note {index}"]


def test_all_kinds_of_frames_give_the_same_file(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", FRAMES)
    kinds = [
        FRAMES,
        tuple(FRAMES),
        MemorySource(FRAMES),
        folder,
        str(folder),
        open_folder(folder),
        Generated(),
    ]
    files = set()
    for index, frames in enumerate(kinds):
        encode_sequence(frames, tmp_path / f"{index}.dgs", QUICK)
        files.add((tmp_path / f"{index}.dgs").read_bytes())
    assert len(files) == 1


def test_notes_reach_the_report_once(tmp_path: Path) -> None:
    report = encode_sequence(Generated(), tmp_path / "a.dgs", EncoderOptions(gof_size=1))
    assert report.notes == ["note 0", "note 1", "note 2"]


def test_paths_may_be_strings(tmp_path: Path) -> None:
    encode_sequence(FRAMES, str(tmp_path / "a.dgs"))
    assert [frame.index for frame in decode_sequence(str(tmp_path / "a.dgs"))] == [0, 1, 2]


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    target = tmp_path / "a.dgs"
    target.write_bytes(b"mine")
    with pytest.raises(InputError, match="exists"):
        encode_sequence(FRAMES, target)
    assert target.read_bytes() == b"mine"
    encode_sequence(FRAMES, target, force=True)
    assert len(list(decode_sequence(target))) == 3


def test_hashes_are_checked_unless_told_otherwise(tmp_path: Path) -> None:
    encode_sequence(still(make_cloud(10), 2), tmp_path / "a.dgs")
    chunks = split_chunks((tmp_path / "a.dgs").read_bytes())
    payload = bytes(16) + chunks[2].payload[16:]
    wrong = [*chunks[:2], type(chunks[2])(chunks[2].chunk_type, 0, payload), *chunks[3:]]
    (tmp_path / "b.dgs").write_bytes(join_chunks(wrong))
    with pytest.raises(VerificationError):
        list(decode_sequence(tmp_path / "b.dgs"))
    found = [frame.state.hash() for frame in decode_sequence(tmp_path / "b.dgs", check=False)]
    assert found == frame_hashes(tmp_path / "a.dgs")


def test_files_that_are_not_there_or_not_ours(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        next(decode_sequence(tmp_path / "none.dgs"))
    (tmp_path / "a.dgs").write_bytes(b"something else")
    with pytest.raises(NotADgsFile):
        next(decode_sequence(tmp_path / "a.dgs"))


def test_decoded_frames_know_their_sequence(tmp_path: Path) -> None:
    encode_sequence(FRAMES, tmp_path / "a.dgs")
    frame = next(decode_sequence(tmp_path / "a.dgs"))
    assert (frame.index, frame.number) == (0, 0)
    assert frame.sequence.num_frames == 3
    assert frame.cloud().num_gaussians == frame.state.num_gaussians == 30
