"""`decode` and `info` on files that are not whole, not ours, or not to be trusted: named, and what to do."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import write_chunk
from lab.chunks import Chunk, join_chunks, split_chunks
from tests.troubles.situations import ball, encode, run, sequence, write
from tests.unit.codec.test_salvage import starts


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three groups of two frames."""
    folder = tmp_path_factory.mktemp("stream")
    assert encode(sequence(folder / "frames", 6), folder / "whole.dgs", "--gof-size", "2").code == 0
    return folder / "whole.dgs"


def cut(data: bytes) -> bytes:
    return data[: starts(data)[3] + 20]


def in_the_first_chunk(data: bytes) -> bytes:
    return data[:14] + b"\xff" + data[15:]


def flipped(data: bytes) -> bytes:
    at = starts(data)[2] + 40
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


def ply(data: bytes) -> bytes:
    return b"ply\nformat binary_little_endian 1.0\n" + data


#: name: what is made of a whole file, exit code, words of the message
REFUSED: dict[str, tuple[Callable[[bytes], bytes], tuple[str, ...]]] = {
    "cut": (cut, ("--salvage", "[truncated]")),
    "without its end": (lambda data: data[:-5], ("--salvage", "[truncated]")),
    "cut in its first frame": (
        lambda data: data[: starts(data)[0] + 60],
        ("--salvage would find none", "[truncated]"),
    ),
    "a PLY": (ply, ("PLY", "encode")),
    "another package's": (lambda data: b"glps" + data, ("dgs-py",)),
    "text": (lambda data: b"hello\n", ("not a dfcgs file",)),
    "empty": (lambda data: b"", ("--salvage would find none", "[truncated]")),
    "damaged in its header": (in_the_first_chunk, ("checksum", "--salvage would find none")),
}


@pytest.mark.parametrize("command", ["decode", "info"])
@pytest.mark.parametrize("name", REFUSED)
def test_a_refused_file_is_named(name: str, command: str, stream: Path, tmp_path: Path) -> None:
    change, words = REFUSED[name]
    bad = tmp_path / "scene 7.dgs"
    bad.write_bytes(change(stream.read_bytes()))
    done = run(command, bad, *([tmp_path / "out"] if command == "decode" else []))
    assert done.code == 3
    assert done.err.count("\n") == 1
    assert str(bad) in done.err
    for word in words:
        assert word in done.err
    assert ("--salvage" in done.err) == any("--salvage" in word for word in words)
    assert [path.name for path in tmp_path.iterdir()] == [bad.name]


def test_a_damaged_frame_brings_up_salvage_and_that_works(stream: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.dgs"
    bad.write_bytes(flipped(stream.read_bytes()))
    done = run("decode", bad, tmp_path / "out")
    assert done.code == 3
    advice = re.search(r"dfcgs (decode \S+) OUTPUT_DIR (--salvage)", done.err)
    assert advice is not None
    assert str(bad) in done.err
    rescued = run(*advice[1].split(), tmp_path / "out", advice[2])
    assert rescued.code == 0
    assert "lost: frames 2 to 3: " in rescued.err
    assert len(list((tmp_path / "out").iterdir())) == 4


def test_salvage_without_an_index(stream: Path, tmp_path: Path) -> None:
    """A length is wrong and the end is gone: what stands behind is found by its looks."""
    data = bytearray(stream.read_bytes())
    data[starts(bytes(data))[2] + 2] = 0xFF
    (tmp_path / "bad.dgs").write_bytes(data[:-20])
    done = run("decode", tmp_path / "bad.dgs", tmp_path / "out", "--salvage")
    assert done.code == 0
    assert "lost: frames 2 to 3: " in done.err
    assert len(list((tmp_path / "out").iterdir())) == 4


@pytest.mark.parametrize("command", ["decode", "info"])
def test_folders_and_files_that_are_not_there(command: str, stream: Path, tmp_path: Path) -> None:
    more = [tmp_path / "out"] if command == "decode" else []
    done = run(command, stream.parent, *more)
    assert done.code == 2
    for word in (str(stream.parent), "folder", f"dfcgs encode {stream.parent}"):
        assert word in done.err
    done = run(command, tmp_path / "nowhere.dgs", *more)
    assert done.code == 2
    assert "nowhere.dgs" in done.err
    assert "does not exist" in done.err


def with_text(data: bytes, text: str) -> bytes:
    """The file with another text about its encoder."""
    chunks = [
        replace(c, payload=text.encode()) if c.chunk_type == ChunkType.ENCODER_INFO else c
        for c in split_chunks(data)
    ]
    return join_chunks(chunks)


def test_info_prints_no_escape_sequences(stream: Path, tmp_path: Path) -> None:
    text = "\x1b]0;owned\x07\x1b[2J caf\u00e9\r\n\x9b31m\u202e\x00"
    path = tmp_path / "odd.dgs"
    path.write_bytes(with_text(stream.read_bytes(), text))
    done = run("info", path)
    assert done.code == 0
    assert all(c.isprintable() for line in done.out.split("\n") for c in line)
    assert "\\x1b]0;owned\\x07" in done.out
    assert "caf\u00e9" in done.out
    as_json = run("info", path, "--json").out
    assert all(c.isprintable() for line in as_json.split("\n") for c in line)
    assert json.loads(as_json)["encoder_info"] == text


def test_unknown_ancillary_chunks_are_passed_over(stream: Path, tmp_path: Path) -> None:
    chunks = split_chunks(stream.read_bytes())
    path = tmp_path / "later.dgs"
    path.write_bytes(join_chunks([*chunks[:2], Chunk(0xB3, 0, b"of another time"), *chunks[2:]]))
    assert write_chunk(0xB3, 0, b"of another time") in path.read_bytes()
    for options in ((), ("--salvage",)):
        done = run("decode", path, "--check-only", *options)
        assert (done.code, done.err) == (0, "")
    assert run("info", path).code == 0


def test_an_encode_says_what_its_decoder_needs(tmp_path: Path) -> None:
    columns = {name: values.repeat(90_000) for name, values in ball(1).items()}
    write(tmp_path / "frames" / "frame_0000.ply", columns)
    done = encode(tmp_path / "frames", tmp_path / "a.dgs", "--verify")
    assert done.code == 0
    option = re.search(r"note: decode \S+ with (--max-gaussians \d+)", done.err)
    assert option is not None
    assert run("decode", tmp_path / "a.dgs", "--check-only").code == 3
    assert run("decode", tmp_path / "a.dgs", "--check-only", *option[1].split()).code == 0
