"""`dfcgs decode` as a user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dfcgs_codec import probe
from dfcgs_codec.ply import property_names, read_ply
from lab.small_clouds import same_cloud
from tests.cli.conftest import GOF_SIZE, NUM_FRAMES
from tests.cli.test_encode import fails
from tests.helpers import dfcgs, dfcgs_process

NAMES = [f"frame_{number:04d}.ply" for number in range(7, 7 + NUM_FRAMES)]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(scope="module")
def decoded(stream: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("decoded") / "out"
    done = dfcgs_process("decode", stream, folder)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert f"{NUM_FRAMES} frames, all hashes right" in done.stdout
    return folder


def test_names_are_the_inputs(decoded: Path) -> None:
    assert names(decoded) == NAMES


def test_properties_are_inrias(decoded: Path) -> None:
    header = (decoded / NAMES[0]).read_bytes().split(b"end_header\n")[0].decode()
    assert header.startswith("ply\nformat binary_little_endian 1.0\n")
    found = [line.split()[-1] for line in header.splitlines() if line.startswith("property")]
    assert found == list(property_names(2))


@pytest.mark.parametrize(
    ("asked", "indices"), [("0:2", [0, 1]), ("1:4", [1, 2, 3]), ("3:", [3, 4]), (":1", [0]), ("4", [4])]
)
def test_seeking_gives_the_same_frames(
    asked: str, indices: list[int], stream: Path, decoded: Path, tmp_path: Path
) -> None:
    assert dfcgs("decode", stream, tmp_path / "part", "--frames", asked).returncode == 0
    assert names(tmp_path / "part") == [NAMES[i] for i in indices]
    for name in names(tmp_path / "part"):
        assert (tmp_path / "part" / name).read_bytes() == (decoded / name).read_bytes()


@pytest.mark.parametrize("asked", ["5:6", "2:9", "3:3", "4:2", "a:b", "-1:2"])
def test_impossible_ranges_are_usage_errors(asked: str, stream: Path, tmp_path: Path) -> None:
    done = dfcgs("decode", stream, tmp_path / "part", f"--frames={asked}")
    fails(done, 2, "frames")
    assert not (tmp_path / "part").exists()


def test_check_only_writes_nothing(stream: Path) -> None:
    before = names(stream.parent)
    done = dfcgs("decode", stream, "--check-only")
    assert done.returncode == 0
    assert f"{NUM_FRAMES} frames" in done.stdout
    assert names(stream.parent) == before


def test_either_a_folder_or_check_only(stream: Path, tmp_path: Path) -> None:
    fails(dfcgs("decode", stream), 2, "OUTPUT_DIR")
    fails(dfcgs("decode", stream, tmp_path / "x", "--check-only"), 2, "OUTPUT_DIR")


def test_a_full_folder_is_kept_without_force(stream: Path, decoded: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("precious")
    fails(dfcgs("decode", stream, tmp_path / "out"), 1, "exists", "--force")
    fails(dfcgs("decode", stream, tmp_path / "out", "--force"), 1, "mine.txt")
    assert names(tmp_path / "out") == ["mine.txt"]
    (tmp_path / "out" / "mine.txt").rename(tmp_path / "out" / "frame_9999.ply")
    assert dfcgs("decode", stream, tmp_path / "out", "--force").returncode == 0
    assert names(tmp_path / "out") == names(decoded)


def test_an_empty_folder_is_used(stream: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert dfcgs("decode", stream, tmp_path / "out").returncode == 0
    assert names(tmp_path / "out") == NAMES


def damaged(stream: Path, target: Path, *, cut: int | None = None, flip: int | None = None) -> Path:
    data = bytearray(stream.read_bytes())
    if flip is not None:
        data[flip] ^= 0x10
    target.write_bytes(data[:cut])
    return target


def gof_start(stream: Path, gof: int) -> int:
    return next(c[2] for c in probe(stream).chunks if c[0] == "INTRA_FRAME" and c[1] == gof * GOF_SIZE)


def test_a_truncated_file_is_refused(stream: Path, tmp_path: Path) -> None:
    cut = damaged(stream, tmp_path / "cut.dgs", cut=-40)
    fails(dfcgs("decode", cut, tmp_path / "out"), 3, "[truncated]")
    assert names(tmp_path) == ["cut.dgs"]


def test_a_damaged_file_is_refused(stream: Path, tmp_path: Path) -> None:
    bad = damaged(stream, tmp_path / "bad.dgs", flip=gof_start(stream, 1) + 60)
    fails(dfcgs("decode", bad, tmp_path / "out"), 3, "[corrupt]", "byte")
    assert names(tmp_path) == ["bad.dgs"]


def test_salvage_of_a_truncated_file(stream: Path, decoded: Path, tmp_path: Path) -> None:
    cut = damaged(stream, tmp_path / "cut.dgs", cut=gof_start(stream, 1) + 100)
    done = dfcgs("decode", cut, tmp_path / "out", "--salvage")
    assert done.returncode == 0
    assert "lost: " in done.stderr
    assert names(tmp_path / "out") == NAMES[:GOF_SIZE]
    for name in NAMES[:GOF_SIZE]:
        assert same_cloud(read_ply(tmp_path / "out" / name)[0], read_ply(decoded / name)[0])


def test_salvage_of_a_damaged_gof(stream: Path, tmp_path: Path) -> None:
    bad = damaged(stream, tmp_path / "bad.dgs", flip=gof_start(stream, 1) + 60)
    done = dfcgs("decode", bad, tmp_path / "out", "--salvage")
    assert done.returncode == 0
    assert "frames 2 to 3" in done.stderr
    assert names(tmp_path / "out") == [NAMES[0], NAMES[1], NAMES[4]]


def test_salvage_of_nothing(stream: Path, tmp_path: Path) -> None:
    cut = damaged(stream, tmp_path / "cut.dgs", cut=gof_start(stream, 0) + 50)
    done = dfcgs("decode", cut, tmp_path / "out", "--salvage")
    assert done.returncode == 3
    assert names(tmp_path) == ["cut.dgs"]


def test_a_foreign_dgs_is_named(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.dgs"
    foreign.write_bytes(b"glps" + bytes(100))
    fails(dfcgs_process("decode", foreign, tmp_path / "out"), 3, "dgs-py", "[not-a-dgs-file]")
    fails(dfcgs("info", foreign), 3, "dgs-py")


def test_any_other_file_is_named(tmp_path: Path) -> None:
    other = tmp_path / "other.dgs"
    other.write_bytes(b"ply\nformat ascii 1.0\n")
    fails(dfcgs("decode", other, tmp_path / "out"), 3, "not a dfcgs file")


def test_a_missing_file_is_a_usage_error(tmp_path: Path) -> None:
    fails(dfcgs("decode", tmp_path / "none.dgs", tmp_path / "out"), 2, "does not exist")
