from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.ply import InputPolicy, PlyHeader
from dfcgs_codec.sequence import MemorySource, open_folder
from lab.small_clouds import make_cloud, same_cloud
from tests.helpers import ply_table, write_frames, write_table


def frames(folder: Path, names: list[str], degree: int = 0) -> Path:
    """Frame i has i + 1 Gaussians, so that the order can be seen."""
    for index, name in enumerate(names):
        write_table(folder / name, ply_table(make_cloud(index + 1, degree)))
    return folder


def counts(folder: Path, pattern: str = "*.ply", **options: bool) -> tuple[list[int], list[int]]:
    source = open_folder(folder, pattern, **options)
    return source.numbers, [header.num_gaussians for header in source.headers]


def refusal(folder: Path, pattern: str = "*.ply") -> str:
    with pytest.raises(InputError) as caught:
        open_folder(folder, pattern)
    assert str(folder) in str(caught.value)
    return str(caught.value)


def test_frames_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    frames(tmp_path, ["frame_9.ply", "frame_10.ply", "frame_8.ply", "frame_11.ply"])
    assert counts(tmp_path) == ([8, 9, 10, 11], [3, 1, 2, 4])


def test_zero_padding_does_not_matter(tmp_path: Path) -> None:
    frames(tmp_path, ["f002.ply", "f1.ply", "f03.ply"])
    assert counts(tmp_path) == ([1, 2, 3], [2, 1, 3])


def test_the_number_that_varies_counts(tmp_path: Path) -> None:
    frames(tmp_path, ["cam2_frame_1_v3.ply", "cam2_frame_2_v3.ply", "cam2_frame_0_v3.ply"])
    assert counts(tmp_path) == ([0, 1, 2], [3, 1, 2])


def test_nested_trees(tmp_path: Path) -> None:
    names = [f"frame_{i}/point_cloud/iteration_7000/point_cloud.ply" for i in (2, 10, 1, 9)]
    frames(tmp_path, names)
    frames(tmp_path, ["frame_1/input.ply", "frame_2/input.ply"])
    pattern = "frame_*/point_cloud/iteration_7000/point_cloud.ply"
    assert counts(tmp_path, pattern, allow_gaps=True) == ([1, 2, 9, 10], [3, 1, 4, 2])


def test_digits_above_the_folder_do_not_count(tmp_path: Path) -> None:
    folder = frames(tmp_path / "take_7" / "2024", ["a1.ply", "a2.ply"])
    assert counts(folder)[0] == [1, 2]


@pytest.mark.parametrize(("name", "number"), [("frame_0042.ply", 42), ("scene.ply", 0), ("v2_17.ply", 17)])
def test_a_single_frame(tmp_path: Path, name: str, number: int) -> None:
    assert counts(frames(tmp_path, [name]))[0] == [number]


def test_gaps_are_refused_by_name_or_kept(tmp_path: Path) -> None:
    frames(tmp_path, ["f1.ply", "f2.ply", "f6.ply"])
    message = refusal(tmp_path)
    assert "frames 3 to 5 are missing (after f2.ply)" in message
    assert "--allow-gaps" in message
    assert counts(tmp_path, allow_gaps=True)[0] == [1, 2, 6]


@pytest.mark.parametrize("names", [["a_1.ply", "a_01.ply"], ["a.ply", "b.ply"], ["x1_1.ply", "x1_01.ply"]])
def test_duplicate_or_missing_numbers_are_refused(tmp_path: Path, names: list[str]) -> None:
    message = refusal(frames(tmp_path, names))
    assert "number" in message
    assert "--pattern" in message


def test_names_with_different_patterns_are_refused(tmp_path: Path) -> None:
    assert "do not share one numbering" in refusal(frames(tmp_path, ["f1.ply", "f2_b3.ply"]))


def test_a_number_too_large_for_the_format_is_refused(tmp_path: Path) -> None:
    refusal(frames(tmp_path, [f"frame_{2**64}.ply"]))


def test_lower_sh_degrees_are_filled_up_with_zeros(tmp_path: Path) -> None:
    frames(tmp_path, ["f0.ply", "f1.ply"])
    write_table(tmp_path / "f2.ply", ply_table(make_cloud(3, 2)))
    source = open_folder(tmp_path)
    assert [header.sh_degree for header in source.headers] == [0, 0, 2]
    assert ["2 of 3 frames (first f0.ply: 0)" in note for note in source.notes] == [True]
    for index in range(3):
        assert source.read(index)[0].sh_degree == 2
    assert not source.read(1)[0].sh_rest.any()


def test_no_match_names_the_pattern(tmp_path: Path) -> None:
    frames(tmp_path, ["f0.ply"])
    assert "no file matches '*.PLYX'" in refusal(tmp_path, "*.PLYX")


@pytest.mark.parametrize("pattern", ["", "/*.ply", "**/**/["])
def test_patterns_that_cannot_be_are_refused(tmp_path: Path, pattern: str) -> None:
    frames(tmp_path, ["f0.ply"])
    refusal(tmp_path, pattern)


def test_folders_that_are_called_like_frames_are_refused(tmp_path: Path) -> None:
    frames(tmp_path, ["frame_0.ply", "frame_1.ply"])
    (tmp_path / "frame_2.ply").mkdir()
    assert "frame_2.ply is a folder" in refusal(tmp_path)


@pytest.mark.parametrize(("name", "words"), [("missing", "does not exist"), ("file.ply", "is not a folder")])
def test_what_is_not_a_folder_is_refused(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "file.ply").touch()
    assert words in refusal(tmp_path / name)


def test_a_frame_that_is_no_ply_is_named(tmp_path: Path) -> None:
    frames(tmp_path, ["f0.ply"])
    (tmp_path / "f1.ply").write_bytes(b"oops")
    assert "f1.ply: not a PLY" in refusal(tmp_path)


def test_frames_are_read_when_asked_for(tmp_path: Path) -> None:
    source = open_folder(frames(tmp_path, ["f0.ply", "f1.ply"], 1))
    cloud, notes = source.read(1)
    assert same_cloud(cloud, make_cloud(2, 1))
    assert notes == []
    assert source.headers == [PlyHeader(1, 1), PlyHeader(2, 1)]


def test_the_policy_reaches_the_frames(tmp_path: Path) -> None:
    table = ply_table(make_cloud(3))
    table["x"][1] = np.nan
    write_table(tmp_path / "f0.ply", table)
    with pytest.raises(InputError, match="NaN"):
        open_folder(tmp_path).read(0)
    cloud, notes = open_folder(tmp_path, policy=InputPolicy(repair=True)).read(0)
    assert np.isfinite(cloud.positions).all()
    assert cloud.opacities[1] < -10
    assert len(notes) == 1


def test_memory_and_folder_sources_agree(tmp_path: Path) -> None:
    clouds = [make_cloud(3, 2, seed) for seed in range(4)]
    memory, folder = MemorySource(clouds), open_folder(write_frames(tmp_path, clouds))
    assert memory.numbers == folder.numbers
    assert memory.headers == folder.headers
    for index in range(4):
        assert same_cloud(memory.read(index)[0], folder.read(index)[0])
