"""Outputs: what may take a name and what may not, what no fault loses, and what the next run finds."""

from __future__ import annotations

import errno
import os
import socket
import stat
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, InputError, VerificationError, encode_sequence
from dfcgs_codec.encoder.frame import encoder as encoding
from dfcgs_codec.files import replace_folder_when_whole, replace_when_whole, system
from dfcgs_codec.ply import PlyHeader
from lab.small_clouds import drifting, make_cloud
from tests.troubles.situations import Outcome, encode, run, sequence

FRAMES = [f"frame_{number:04d}.ply" for number in range(3)]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def refused(done: Outcome, *words: str, without: str = "\0") -> None:
    """One line that holds all of `words`, and not `without`."""
    assert done.code == 1, done
    assert done.out == ""
    assert len(done.err.splitlines()) == 1
    assert all(word in done.err for word in words), done.err
    assert without not in done.err


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sequence(tmp_path_factory.mktemp("input") / "frames")


@pytest.fixture(scope="module")
def stream(frames: Path) -> Path:
    path = frames.parent / "scene.dgs"
    assert encode(frames, path, "--quiet").code == 0
    return path


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """Frames that cannot even be opened: whatever is said before that is said first."""
    folder = tmp_path / "broken"
    folder.mkdir()
    (folder / "frame_0000.ply").write_bytes(b"no PLY at all")
    return folder


# --- names that are refused before anything else --------------------------------------------------------


def a_socket(path: Path) -> None:
    here = os.getcwd()
    os.chdir(path.parent)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)
    os.chdir(here)


REFUSED_FILES: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
    "a folder": (Path.mkdir, ("is a folder: name a file in it, such as", "out/frames.dgs")),
    "a link to a folder": (lambda path: path.symlink_to("broken"), ("is a folder: name a file in it",)),
    "a named pipe": (os.mkfifo, ("a named pipe",)),
    "a socket": (a_socket, ("a socket",)),
    "a link to a device": (lambda path: path.symlink_to(os.devnull), ("a device",)),
    "a link to a stream": (lambda path: path.symlink_to("/dev/stdout"), ("a stream of this process",)),
    "a link to itself": (lambda path: path.symlink_to("out"), ("a link that leads back to itself",)),
}


@pytest.mark.parametrize("what", REFUSED_FILES)
def test_what_is_no_file_is_never_replaced_by_one(what: str, broken: Path, tmp_path: Path) -> None:
    make, words = REFUSED_FILES[what]
    target = tmp_path / "out"
    make(target)
    before = _what_it_is(target)
    for options in ((), ("--force",)):
        refused(encode(broken, target, *options), str(target), *words, without="--force")
    assert _what_it_is(target) == before
    assert names(tmp_path) == ["broken", "out"]


def _what_it_is(path: Path) -> tuple[int, ...]:
    # following a link changes when it was last read, and nothing else
    found = path.lstat()
    return found.st_mode, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


REFUSED_NAMES = {
    "a pipe, by habit": ("-", ("'-'", "a pipe cannot be the output")),
    "nothing": ("", ("empty name",)),
    "a folder, by its name": ("new/", ("new/frames.dgs",)),
    "a PLY": ("frame_0001.ply", ("frame_0001.ply", "a PLY")),
    "a missing folder": ("no/out.dgs", ("no such folder; create it first",)),
    "a file as its folder": ("file/out.dgs", ("is a file, not a folder",)),
    "an existing file": ("file", ("file exists; --force replaces it",)),
    "standard output": ("/dev/stdout", ("a stream of this process",)),
    "an unwritable folder": ("/proc/out.dgs", ("/proc/out.dgs: nothing can be written into /proc",)),
}


@pytest.mark.parametrize("what", REFUSED_NAMES)
def test_names_that_no_file_can_have(
    what: str, broken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_bytes(b"mine")
    target, words = REFUSED_NAMES[what]
    refused(run("encode", broken, target), *words)
    assert names(tmp_path) == ["broken", "file"]
    assert Path("file").read_bytes() == b"mine"


REFUSED_FOLDERS = {
    "a pipe, by habit": ("-", ("'-'", "a pipe cannot be the output")),
    "a file": ("scene.dgs", ("is a file, not a folder",)),
    "a named pipe": ("pipe", ("a named pipe, not a folder",)),
    "the folder of the file": (".", ("holds scene.dgs itself",)),
    "a missing folder": ("no/out", ("no such folder; create it first",)),
    "an unwritable folder": ("/proc/out", ("nothing can be written into /proc",)),
    "a folder with a linked frame": ("links", ("holds frame_0000.ply", "a link or no file")),
}


@pytest.mark.parametrize("what", REFUSED_FOLDERS)
def test_names_that_no_folder_of_frames_can_have(
    what: str, stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.dgs").write_bytes(stream.read_bytes())
    Path("links").mkdir()
    Path("links/frame_0000.ply").symlink_to(tmp_path / "scene.dgs")
    os.mkfifo("pipe")
    before = names(tmp_path)
    target, words = REFUSED_FOLDERS[what]
    refused(run("decode", "scene.dgs", target, "--force"), *words)
    assert names(tmp_path) == before
    assert Path("scene.dgs").read_bytes() == stream.read_bytes()


def test_a_frame_is_not_replaced(frames: Path, tmp_path: Path) -> None:
    folder = sequence(tmp_path / "frames", name="frame_{:04d}.bin")
    done = encode(folder, folder / "frame_0001.bin", "--force", "--pattern", "*.bin")
    refused(done, "frame_0001.bin is one of the frames")
    assert names(folder) == [f"frame_{number:04d}.bin" for number in range(3)]
    with pytest.raises(InputError, match="is the name of a PLY"):
        encode_sequence(frames, frames / FRAMES[1], force=True)


def test_beside_the_frames_is_a_good_place(tmp_path: Path) -> None:
    folder = sequence(tmp_path)
    assert encode(folder, folder / "out.dgs", "--quiet").code == 0
    assert names(folder) == [*FRAMES, "out.dgs"]


@pytest.mark.parametrize("exists", [False, True])
def test_a_links_target_is_written(exists: bool, frames: Path, tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    link, real = tmp_path / "out.dgs", tmp_path / "store" / "real.dgs"
    link.symlink_to(Path("store", "real.dgs"))
    if exists:
        real.write_bytes(b"mine")
        refused(encode(frames, link), "out.dgs exists")
        assert real.read_bytes() == b"mine"
    assert encode(frames, link, "--quiet", *["--force"] * exists).code == 0
    assert link.is_symlink()
    assert real.read_bytes() == link.read_bytes() != b"mine"
    assert (names(tmp_path), names(real.parent)) == (["out.dgs", "store"], ["real.dgs"])


def test_who_may_read_a_replaced_file_stays_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "a").touch(mode=0o600)
    (tmp_path / "a").chmod(0o604)
    with replace_when_whole(tmp_path / "a", force=True):
        pass
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o604


def test_long_names(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 251 + ".dgs")
    with replace_when_whole(target, force=False):
        pass
    assert names(tmp_path) == [target.name]


# --- what appears under the name meanwhile --------------------------------------------------------------


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appears_is_kept(links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not links:
        monkeypatch.setattr(os, "link", fails_with(errno.EPERM))
    target = tmp_path / "out.dgs"

    def both_write() -> None:
        with replace_when_whole(target, force=False) as file:
            file.write(b"ours")
            target.write_bytes(b"somebody's")

    with pytest.raises(InputError, match="appeared"):
        both_write()
    assert target.read_bytes() == b"somebody's"
    assert names(tmp_path) == ["out.dgs"]
    with replace_when_whole(tmp_path / "b.dgs", force=False) as file:
        file.write(b"ours")
    assert (tmp_path / "b.dgs").read_bytes() == b"ours"
    assert names(tmp_path) == ["b.dgs", "out.dgs"]


@pytest.mark.parametrize("exists", [False, True])
@pytest.mark.parametrize("name", ["thesis.txt", FRAMES[1]])
def test_a_folder_that_fills_is_kept(exists: bool, name: str, tmp_path: Path) -> None:
    target = tmp_path / "out"
    if exists:
        target.mkdir()

    def both_fill() -> None:
        with replace_folder_when_whole(target, force=False) as folder:
            fill(folder, "new")
            target.mkdir(exist_ok=True)
            (target / name).write_text("somebody's")

    with pytest.raises(InputError, match="appeared"):
        both_fill()
    assert (names(tmp_path), names(target)) == (["out"], [name])
    assert (target / name).read_text() == "somebody's"


def test_with_force_only_frames_go(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    fill(target, "old", 4)
    with replace_folder_when_whole(target, force=True) as folder:
        fill(folder, "new")
        (target / "thesis.txt").write_text("somebody's")
    assert names(target) == [*FRAMES, "thesis.txt"]
    assert contents(target) == ["new"] * 3


def test_a_second_run_on_one_output_is_refused_at_once(broken: Path, stream: Path, tmp_path: Path) -> None:
    with replace_when_whole(tmp_path / "out.dgs", force=False) as file:
        file.write(b"ours")
        refused(encode(broken, tmp_path / "out.dgs", "--force"), "is being written by another run")
    assert (tmp_path / "out.dgs").read_bytes() == b"ours"
    for exists in (False, True):
        target = tmp_path / f"folder{exists}"
        if exists:
            target.mkdir()
        with replace_folder_when_whole(target, force=False) as folder:
            fill(folder, "ours")
            refused(run("decode", stream, target, "--force"), "is being written by another run")
        assert contents(target) == ["ours"] * 3


def test_of_two_encoders_of_one_name_one_succeeds(tmp_path: Path) -> None:
    results: list[object] = []

    def code() -> None:
        try:
            results.append(encode_sequence(drifting(make_cloud(50), 3), tmp_path / "a.dgs").num_bytes)
        except InputError as error:
            results.append(error)

    threads = [threading.Thread(target=code) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [isinstance(result, int) for result in results].count(True) == 1
    assert names(tmp_path) == ["a.dgs"]


# --- folders that stay, and faults -----------------------------------------------------------------------


def fill(folder: Path, text: str, count: int = 3) -> None:
    for number in range(count):
        (folder / f"frame_{number:04d}.ply").write_text(text)


def contents(folder: Path) -> list[str]:
    return [path.read_text() for path in sorted(folder.glob("frame_*"))]


def fails_with(number: int) -> Callable[..., None]:
    def fail(*arguments: Any, **named: Any) -> None:
        raise OSError(number, os.strerror(number), *map(str, arguments[:1]))

    return fail


def test_the_folder_itself_stays_and_nothing_is_made_around_it(
    stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with mount points: neither the folder nor anything beside it can be renamed or made."""
    target = tmp_path / "volume"
    (target / "lost+found").mkdir(parents=True)
    before = target.stat()
    parent = tmp_path.stat().st_mtime_ns
    rename = os.rename

    def guarded(source: Any, place: Any, **options: Any) -> None:
        if Path(place) == target or Path(source) == target:
            raise OSError(errno.EBUSY, "Device or resource busy")
        rename(source, place, **options)

    monkeypatch.setattr(os, "rename", guarded)
    monkeypatch.setattr(os, "replace", guarded)
    for force in ([], ["--force"]):
        done = run("decode", stream, target, "--quiet", *force)
        assert (done.code, done.err) == (0, "")
        assert names(target) == [*FRAMES, "lost+found"]
    refused(run("decode", stream, target), "exists; --force")
    after = target.stat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert tmp_path.stat().st_mtime_ns == parent


def with_a_fault(monkeypatch: pytest.MonkeyPatch, step: int, fault: Callable[[], None]) -> None:
    """The `step`-th time that anything is renamed or removed, `fault` instead."""
    steps = iter(range(10**6))

    def faulty(do: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any, **options: Any) -> None:
            if next(steps) == step:
                fault()
            do(*arguments, **options)

        return call

    for name in ("rename", "unlink", "rmdir"):
        monkeypatch.setattr(os, name, faulty(getattr(os, name)))


def raise_input_output_error() -> None:
    raise OSError(errno.EIO, "Input/output error")


#: renames of three old frames, two folders and three new frames, and some of the removals behind them
STEPS = range(12)


@pytest.mark.parametrize("step", STEPS)
def test_a_fault_loses_no_frame(step: int, tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    fill(target, "old", 4)
    failed = None
    with pytest.MonkeyPatch.context() as patch:
        try:
            with replace_folder_when_whole(target, force=True) as folder:
                fill(folder, "new")
                with_a_fault(patch, step, raise_input_output_error)
        except InputError as error:
            failed = str(error)
    assert failed is None or "Input/output error" in failed
    # a fault while old frames are removed comes after the new ones are in their place
    assert (failed is None) == (step > 8)
    assert contents(target) == (["new"] * 3 if failed is None else ["old"] * 4)
    with replace_folder_when_whole(target, force=True) as folder:
        fill(folder, "newer")
    assert contents(target) == ["newer"] * 3
    assert names(target) == FRAMES


@pytest.mark.skipif(not hasattr(os, "fork"), reason="dies in a process of its own")
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("old", [0, 4])
def test_a_kill_loses_no_frame_and_the_next_run_finishes(old: int, step: int, tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    fill(target, "old", old)
    child = os.fork()
    if not child:
        try:
            with (
                pytest.MonkeyPatch.context() as patch,
                replace_folder_when_whole(target, force=True) as folder,
            ):
                fill(folder, "new")
                with_a_fault(patch, step, lambda: os._exit(9))
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    everything = [path.read_text() for path in target.rglob("frame_*")]
    assert everything.count("old") == old or everything.count("new") == 3
    # whatever the next run is, refused or not, it puts the folder right first
    with suppress(InputError, RuntimeError), replace_folder_when_whole(target, force=False):
        raise RuntimeError
    assert contents(target) in (["old"] * old, ["new"] * 3)
    assert names(target) in (FRAMES, [*FRAMES, "frame_0003.ply"], [])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="dies in a process of its own")
def test_what_a_dead_run_left_goes_with_the_next(frames: Path, stream: Path, tmp_path: Path) -> None:
    (tmp_path / ".other.dgs.0123456789ab.tmp").touch()
    for force in (False, True):
        child = os.fork()
        if not child:
            try:
                with (
                    replace_when_whole(tmp_path / "out.dgs", force=force) as file,
                    replace_folder_when_whole(tmp_path / "out", force=force) as folder,
                ):
                    file.write(b"half")
                    fill(folder, "half")
                    os._exit(9)
            finally:
                os._exit(1)
        os.waitpid(child, 0)
        assert len(names(tmp_path)) == (4 if force else 3)
        assert encode(frames, tmp_path / "out.dgs", "--quiet", *["--force"] * force).code == 0
        assert run("decode", stream, tmp_path / "out", "--quiet", *["--force"] * force).code == 0
        assert names(tmp_path) == [".other.dgs.0123456789ab.tmp", "out", "out.dgs"]
        assert names(tmp_path / "out") == FRAMES


# --- on the disk ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("exists", [False, True])
def test_frames_are_on_the_disk_before_they_have_their_names(
    exists: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "out"
    if exists:
        target.mkdir()
    done: list[str] = []
    monkeypatch.setattr(system, "sync_open", lambda descriptor: done.append("sync"))
    rename = os.rename
    monkeypatch.setattr(os, "rename", lambda a, b: (done.append("rename"), rename(a, b)))
    with replace_folder_when_whole(target, force=False) as folder:
        fill(folder, "new")
    assert done[:3] == ["sync"] * 3
    assert set(done[3:]) == {"rename"}


def test_a_file_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[tuple[int, bool]] = []
    fsync = os.fsync

    def note(descriptor: int) -> None:
        found = os.fstat(descriptor)
        synced.append((found.st_size if stat.S_ISREG(found.st_mode) else -1, (tmp_path / "a").exists()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", note)
    with replace_when_whole(tmp_path / "a", force=False) as file:
        file.write(b"12345")
    assert synced == [(5, False), (-1, True)]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EFBIG, errno.EDQUOT])
def test_a_full_disk_says_which_file(
    number: int, frames: Path, stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system gives these errors no name."""

    def full(*arguments: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("dfcgs_codec.bitstream.container.ContainerWriter.finish", full)
    refused(encode(frames, tmp_path / "big.dgs"), "big.dgs: ", os.strerror(number))
    monkeypatch.setattr("dfcgs_codec.cli.decode.write_ply", full)
    refused(run("decode", stream, tmp_path / "big"), "big/frame_0000.ply: ", os.strerror(number))
    assert names(tmp_path) == []


def test_half_an_array_on_a_full_disk_is_explained(
    stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(*arguments: Any) -> None:
        raise OSError("3400 requested and 1024 written")

    monkeypatch.setattr("dfcgs_codec.cli.decode.write_ply", half)
    refused(run("decode", stream, tmp_path / "big"), "frame_0000.ply: not written whole", "is full")


# --- proven before it has its name -----------------------------------------------------------------------


def damage(data: bytearray, what: str) -> bytearray:
    if what == "a bit":
        data[len(data) // 2] ^= 4
        return data
    return data[:-20] if what == "the end" else data[:40] + data[60:]


class Changing:
    """A source whose frames are not what it says of them."""

    def __init__(self, frame: GaussianCloud) -> None:
        self.frame = frame
        self.numbers, self.headers = [5, 6, 7], [PlyHeader(50, 0)] * 3

    def read(self, index: int) -> tuple[GaussianCloud, list[str]]:
        return (self.frame if index == 2 else make_cloud(50)), []


@pytest.mark.parametrize(("count", "degree"), [(49, 0), (50, 1)])
def test_frames_that_are_not_what_was_planned(count: int, degree: int, tmp_path: Path) -> None:
    expected = f"frame 7: {count} Gaussians of SH degree {degree}, but 50 of SH degree 0 were announced"
    with pytest.raises(InputError, match=expected):
        encode_sequence(Changing(make_cloud(count, degree)), tmp_path / "a.dgs")
    assert names(tmp_path) == []


@pytest.mark.parametrize("what", ["a bit", "the end", "the middle"])
def test_a_file_that_does_not_read_back_gets_no_name(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = encoding._write

    def writes_badly(file: Any, *arguments: Any) -> Any:
        report = write(file, *arguments)
        file.seek(0)
        data = damage(bytearray(file.read()), what)
        file.seek(0)
        file.truncate()
        file.write(data)
        return report

    monkeypatch.setattr(encoding, "_write", writes_badly)
    with pytest.raises(VerificationError, match="does not read back"):
        encode_sequence(drifting(make_cloud(50), 3), tmp_path / "a.dgs", EncoderOptions(gof_size=2))
    assert names(tmp_path) == []
