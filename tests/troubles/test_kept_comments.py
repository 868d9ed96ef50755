"""Comments that change how a viewer shows a frame survive; all others go."""

from __future__ import annotations

from pathlib import Path

from dfcgs_codec import probe
from dfcgs_codec.ply import peek_header
from tests.troubles.situations import ball, encode, run, write

SHOWN = (b"SplatRenderMode: mip", b"Vertical axis: y", "up: gr\u00f6\u00dfer z".encode())


def frames(folder: Path, *, last: tuple[bytes, ...] = SHOWN) -> Path:
    for index, lines in enumerate((SHOWN, SHOWN, last)):
        others = [b"comment camera %d" % camera for camera in range(30)]
        write(
            folder / f"frame_{index:04d}.ply", ball(60), comments=[*others, *(b"comment " + c for c in lines)]
        )
    return folder


def test_they_are_kept_and_written_back(tmp_path: Path) -> None:
    assert encode(frames(tmp_path / "in"), tmp_path / "a.dgs").code == 0
    assert probe(tmp_path / "a.dgs").comments == list(SHOWN)
    assert run("decode", tmp_path / "a.dgs", tmp_path / "out", "--frames", "2:3").code == 0
    assert peek_header(tmp_path / "out" / "frame_0002.ply").comments == SHOWN


def test_frames_that_differ_are_said(tmp_path: Path) -> None:
    done = encode(frames(tmp_path / "in", last=(b"SplatRenderMode: default",)), tmp_path / "a.dgs")
    assert "comments" in done.err
    assert probe(tmp_path / "a.dgs").comments == list(SHOWN)


def test_without_comments_there_is_no_chunk(tmp_path: Path) -> None:
    write(tmp_path / "in" / "frame_0000.ply", ball(60))
    assert encode(tmp_path / "in", tmp_path / "a.dgs").code == 0
    assert "PLY_COMMENTS" not in probe(tmp_path / "a.dgs").chunk_bytes
