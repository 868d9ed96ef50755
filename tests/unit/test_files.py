from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.files import replace_folder_when_whole, replace_when_whole


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def write_half(target: Path, error: type[BaseException], *, force: bool = False) -> None:
    with replace_when_whole(target, force=force) as file:
        file.write(b"half")
        raise error


def fill_half(target: Path, error: type[BaseException], *, force: bool = False) -> None:
    with replace_folder_when_whole(target, force=force) as folder:
        (folder / "a").touch()
        raise error


# --- files --------------------------------------------------------------------------------------------


def test_a_file_appears_only_when_whole(tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    with replace_when_whole(target, force=False) as file:
        file.write(b"data")
        assert not target.exists()
    assert target.read_bytes() == b"data"
    assert names(tmp_path) == ["out.dgs"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_error_leaves_no_file(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error):
        write_half(tmp_path / "out.dgs", error)
    assert names(tmp_path) == []


def test_an_error_keeps_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    target.write_bytes(b"frame_old.ply")
    with pytest.raises(ValueError):
        write_half(target, ValueError, force=True)
    assert target.read_bytes() == b"frame_old.ply"
    assert names(tmp_path) == ["out.dgs"]


def test_an_existing_file_needs_force(tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    target.write_bytes(b"frame_old.ply")
    with (
        pytest.raises(InputError, match=r"out\.dgs exists; --force"),
        replace_when_whole(target, force=False),
    ):
        pass
    assert target.read_bytes() == b"frame_old.ply"
    with replace_when_whole(target, force=True) as file:
        file.write(b"new")
    assert target.read_bytes() == b"new"


def test_the_folder_of_a_file_must_exist(tmp_path: Path) -> None:
    target = tmp_path / "no" / "out.dgs"
    with pytest.raises(InputError, match="no such folder"), replace_when_whole(target, force=False):
        pass
    assert names(tmp_path) == []


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_is_not_replaced_by_a_file(tmp_path: Path, force: bool) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "keep").touch()
    with pytest.raises(InputError, match="folder"), replace_when_whole(folder, force=force):
        pass
    assert names(folder) == ["keep"]
    assert names(tmp_path) == ["folder"]


def test_permissions_follow_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with replace_when_whole(tmp_path / "a", force=False):
            pass
        with replace_folder_when_whole(tmp_path / "b", force=False):
            pass
        assert os.umask(0o027) == 0o027
    finally:
        os.umask(before)
    assert mode(tmp_path / "a") == 0o640
    assert mode(tmp_path / "b") == 0o750


# --- folders ------------------------------------------------------------------------------------------


def test_a_folder_appears_only_when_whole(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with replace_folder_when_whole(target, force=False) as folder:
        (folder / "a").write_text("1")
        assert not target.exists()
    assert names(target) == ["a"]
    assert names(tmp_path) == ["out"]


def test_an_empty_folder_may_exist(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    with replace_folder_when_whole(target, force=False) as folder:
        (folder / "a").touch()
    assert names(target) == ["a"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_leaves_no_folder(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error):
        fill_half(tmp_path / "out", error)
    assert names(tmp_path) == []


def test_a_full_folder_needs_force(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "frame_old.ply").touch()
    with pytest.raises(InputError, match="--force"), replace_folder_when_whole(target, force=False):
        pass
    assert names(target) == ["frame_old.ply"]
    with replace_folder_when_whole(target, force=True) as folder:
        (folder / "new").touch()
    assert names(target) == ["new"]


def test_an_error_keeps_the_old_folder(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "frame_old.ply").touch()
    with pytest.raises(ValueError):
        fill_half(target, ValueError, force=True)
    assert names(target) == ["frame_old.ply"]
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("force", [False, True])
def test_a_file_is_not_replaced_by_a_folder(tmp_path: Path, force: bool) -> None:
    target = tmp_path / "out"
    target.write_text("keep")
    with pytest.raises(InputError), replace_folder_when_whole(target, force=force):
        pass
    assert target.read_text() == "keep"


@pytest.mark.parametrize("name", [".", "inner/.."])
def test_the_working_folder_is_not_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "precious").touch()
    monkeypatch.chdir(tmp_path)
    try:
        with replace_folder_when_whole(Path(name), force=True) as folder:
            (folder / "new").touch()
    except InputError:
        assert names(tmp_path) == ["inner", "precious"]
    else:
        assert names(tmp_path) == ["new"]


def test_an_interrupt_as_the_file_appears_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Path.open

    def interrupted(self: Path, *arguments: Any) -> None:
        opened(self, *arguments).close()
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "open", interrupted)
    with pytest.raises(KeyboardInterrupt), replace_when_whole(tmp_path / "a.dgs", force=False):
        pass
    assert list(tmp_path.iterdir()) == []
