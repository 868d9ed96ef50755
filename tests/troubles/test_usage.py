"""Mistyped command lines: exit code 2 and one line that says what is wrong and how it is right."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.troubles.situations import run

MISTYPED: dict[str, tuple[str, ...]] = {
    "": ("name a command: encode, decode, info", "'dfcgs --help'"),
    "enocde frames out.dgs": ("no command 'enocde'", "did you mean encode?"),
    "frames out.dgs": ("no command 'frames'", "there are encode, decode, info"),
    "--froce": ("--froce", "'dfcgs --help'"),
    "encode": ("FRAMES", "OUTPUT", "'dfcgs encode --help'"),
    "decode": ("FILE", "[OUTPUT_DIR]", "'dfcgs decode --help'"),
    "info": ("FILE", "'dfcgs info --help'"),
    "encode frames out.dgs --gof_size 3": ("--gof_size", "--gof-size"),
    "encode frames out.dgs --qp high": ("--qp", "high"),
    "encode frames out.dgs --fps fast": ("--fps", "29.97 or 30000/1001"),
    "encode frames out.dgs --fps 30/0": ("--fps", "29.97 or 30000/1001"),
    "encode frames out.dgs --bound position": ("--bound", "position=0.001"),
    "encode frames out.dgs --gof-size many": ("--gof-size", "neither auto nor a number"),
    "encode frames out.dgs --quality best": ("--quality", "transparent"),
    "encode frames out.dgs --motion off": ("--motion", "'dfcgs encode --help'"),
    "encode frames out.dgs --quality": ("--quality", "argument"),
    "encode frames out.dgs --jobs all": ("--jobs", "all"),
    "decode frames/f.dgs out --frames 3:1": ("--frames", "A:B is frame A up to, not with, frame B"),
    "decode frames/f.dgs out --frames a": ("--frames", "10:20, 10: or 10"),
    "decode frames/f.dgs": ("name an OUTPUT_DIR, or --check-only",),
}

#: read, and refused by the encoder
OUT_OF_RANGE: dict[str, str] = {
    "--fps 0": "--fps 0: above 0",
    "--qp nan": "--qp nan: 0 to 51",
    "--gof-size 0": "--gof-size 0: auto, or 1 to",
    "--bound x=1": "--bound x: unknown; known are position",
    "--bound position=0": "a bound is a number above 0",
    "--jobs 0": "--jobs 0: 1 or more",
    "--quality 99": "--quality 99: 15 to 70 dB, or lossless",
    "--psnr 14": "--quality 14: 15 to 70 dB, or lossless",
    "--quality lossless --qp 9": "--qp with --quality lossless: choose one",
    "--quality lossless --gof-size 9": "--gof-size 9 with --quality lossless: P-frames are quantised",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "f.dgs").touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.parametrize("line", MISTYPED)
def test_mistyped(line: str, here: Path) -> None:
    done = run(*line.split())
    assert (done.code, done.out) == (2, ""), done.err
    assert done.err.startswith("dfcgs: ")
    assert done.err.count("\n") == 1
    for words in MISTYPED[line]:
        assert words in done.err
    assert names(here) == ["frames", "frames/f.dgs"]


@pytest.mark.parametrize("options", OUT_OF_RANGE)
def test_out_of_range(options: str, here: Path) -> None:
    done = run("encode", "frames", "out.dgs", *options.split())
    assert (done.code, done.out) == (1, ""), done.err
    assert done.err.count("\n") == 1
    assert OUT_OF_RANGE[options] in done.err
    assert names(here) == ["frames", "frames/f.dgs"]
