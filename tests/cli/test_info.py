"""`dfcgs info`, and what all commands share."""

from __future__ import annotations

import json
import os
from itertools import pairwise
from pathlib import Path

from dfcgs_codec import __version__
from tests.cli.conftest import NUM_FRAMES
from tests.helpers import dfcgs, dfcgs_process

KEYS = {
    "bitstream_version",
    "profile",
    "level",
    "sh_degree",
    "output_order",
    "num_frames",
    "frame_rate",
    "unit_exponents",
    "model_id",
    "encoder_info",
    "num_bytes",
    "ply_bytes",
    "compression_ratio",
    "bits_per_gaussian",
    "bytes_by_frame_type",
    "bytes_by_chunk_type",
    "bytes_by_attribute",
    "frames",
}


def test_json_adds_up(stream: Path) -> None:
    found = json.loads(dfcgs("info", stream, "--json").stdout)
    assert set(found) == KEYS
    size = stream.stat().st_size
    assert found["num_bytes"] == size
    assert sum(found["bytes_by_chunk_type"].values()) == size - 8  # the magic number is no chunk
    assert sum(found["bytes_by_attribute"].values()) == size
    assert found["num_frames"] == len(found["frames"]) == NUM_FRAMES
    for key in ("POSITION", "SCALE", "ROTATION", "OPACITY", "SH_DC", "SH_1", "SH_2", "HEADERS"):
        assert found["bytes_by_attribute"][key] > 0
    assert found["bytes_by_frame_type"]["I"] > found["bytes_by_frame_type"]["P"] > 0
    assert found["ply_bytes"] == NUM_FRAMES * 300 * 41 * 4
    assert abs(found["compression_ratio"] - found["ply_bytes"] / size) < 1e-3


def test_chunks_cover_the_file(stream: Path) -> None:
    chunks = json.loads(dfcgs("info", stream, "--json", "--chunks").stdout)["chunks"]
    assert chunks[0]["offset"] == 8
    for before, after in pairwise(chunks):
        assert before["offset"] + before["num_bytes"] == after["offset"]
    assert chunks[-1]["offset"] + chunks[-1]["num_bytes"] == stream.stat().st_size


def test_text(stream: Path) -> None:
    done = dfcgs_process("info", stream, "--frames", "--chunks")
    assert done.returncode == 0
    assert done.stderr == ""
    for word in (
        "5 at 30 per second",
        "SH degree 2",
        "quality=37dB qp=",
        "estimate=38",
        "x smaller",
        "bits per Gaussian",
        "inter_frame",
    ):
        assert word in done.stdout


def test_truncated_headers_are_refused(stream: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.dgs"
    cut.write_bytes(stream.read_bytes()[:200])
    done = dfcgs("info", cut)
    assert done.returncode == 3
    assert "[truncated]" in done.stderr


def test_version_and_help() -> None:
    assert dfcgs_process("--version").stdout.strip().endswith(__version__)
    for command in ((), ("encode",), ("decode",), ("info",), ("view",), ("export",)):
        done = dfcgs(*command, "--help")
        assert done.returncode == 0
        assert "Examples:" in done.stdout


def test_help_is_quick() -> None:
    def once() -> float:
        # of the command alone: the machine may be busy
        before = os.times()
        assert dfcgs_process("--help").returncode == 0
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    # 0.3 s is the aim and 0.1 s usual; a slow machine gets some room
    assert min(once() for _ in range(3)) < 1.0
