"""`dfcgs encode` as a user types it."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import decode_sequence, probe
from lab.small_clouds import drifting, make_cloud, real_cloud
from tests.cli.conftest import NUM_FRAMES
from tests.helpers import dfcgs, dfcgs_process, ply_table, write_frames, write_table

#: a QP, so that no quality is searched for
QUICK = ("--qp", "27")


def fails(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    """One line on stderr that holds all of `words`, nothing on stdout."""
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert done.stderr.startswith("dfcgs: ")
    assert len(done.stderr.splitlines()) == 1


def test_report_on_stdout(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    done = dfcgs("encode", frames_dir, target, "--verify")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert f"{NUM_FRAMES} frames (1 I, {NUM_FRAMES - 1} P, 0 skipped)" in done.stdout
    assert f"{target.stat().st_size} bytes" in done.stdout
    for name in ("position", "rotation", "scale", "alpha", "colour", "sh"):
        assert f"\n{name} " in done.stdout
    assert done.stdout.endswith("verified\n")


def test_json(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    done = dfcgs("encode", frames_dir, target, "--json", "--verify")
    found = json.loads(done.stdout)
    told = {"num_bytes", "qp", "estimated_psnr", "num_unseen", "unseen_cost_db"}
    told |= {"errors", "notes", "verified", "frames"}
    assert set(found) == told
    assert found["estimated_psnr"] == pytest.approx(38, abs=1.0)
    assert found["num_unseen"] is None
    assert found["verified"] is True
    assert found["num_bytes"] == target.stat().st_size
    assert [f["number"] for f in found["frames"]] == [7, 8, 9, 10, 11]
    assert 0 < found["errors"]["position"]["mean"] <= found["errors"]["position"]["max"]


def test_settings_reach_the_stream(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    options = ("--gof-size", "2", "--fps", "30000/1001", "--order", "free", "--qp", "20.5")
    assert dfcgs("encode", frames_dir, target, *options).returncode == 0
    info = probe(target)
    assert info.header.frame_rate == (30000, 1001)
    assert info.header.output_order.name == "FREE"
    assert [f.frame_type for f in info.frames] == ["I", "P", "I", "P", "I"]
    assert "qp=20.5" in info.encoder_info


def test_qualities_are_ordered(frames_dir: Path, tmp_path: Path) -> None:
    sizes = []
    for quality in ("low", "medium", "high", "transparent"):
        target = tmp_path / f"{quality}.dgs"
        assert dfcgs("encode", frames_dir, target, "--quality", quality).returncode == 0
        sizes.append(target.stat().st_size)
    assert sizes == sorted(sizes)
    assert len(set(sizes)) == 4


def test_jobs_do_not_change_the_bytes(frames_dir: Path, tmp_path: Path) -> None:
    for jobs in ("1", "2"):
        done = dfcgs("encode", frames_dir, tmp_path / jobs, "--gof-size", "2", "--jobs", jobs, *QUICK)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "1").read_bytes() == (tmp_path / "2").read_bytes()


def test_lossless(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    done = dfcgs("encode", frames_dir, target, "--quality", "lossless", "--order", "input", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert {frame["kind"] for frame in report["frames"]} == {"I"}
    assert report["qp"] is report["estimated_psnr"] is None
    assert all(error["max"] == 0 for error in report["errors"].values())
    for frame in decode_sequence(target):
        source = frames_dir / f"frame_{frame.number:04d}.ply"
        assert source.read_bytes().endswith(ply_table(frame.cloud()).tobytes())


def test_bound_is_reported_and_kept(frames_dir: Path, tmp_path: Path) -> None:
    options = (*QUICK, "--bound", "position=0.0005", "--bound", "rotation=0.1", "--bound", "colour=0.01")
    done = dfcgs("encode", frames_dir, tmp_path / "out.dgs", "--json", *options)
    errors = json.loads(done.stdout)["errors"]
    assert errors["position"]["max"] <= 0.0005
    assert errors["rotation"]["max"] <= 0.1
    assert errors["colour"]["max"] <= 0.01


def test_nested_tree(tmp_path: Path) -> None:
    name = "frame_{:03d}/point_cloud/iteration_7000/point_cloud.ply"
    for number in range(9, 12):
        (tmp_path / name.format(number)).parent.mkdir(parents=True)
    write_frames(tmp_path, drifting(make_cloud(40), 3), name, first=9)
    pattern = "frame_*/point_cloud/iteration_*/point_cloud.ply"
    done = dfcgs("encode", tmp_path, tmp_path / "out.dgs", "--pattern", pattern, *QUICK)
    assert done.returncode == 0, done.stderr
    assert [f.frame_number for f in probe(tmp_path / "out.dgs").frames] == [9, 10, 11]


def test_gaps(tmp_path: Path) -> None:
    write_frames(tmp_path, drifting(make_cloud(40), 4))
    (tmp_path / "frame_0002.ply").unlink()
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, "frames 2 to 2 are missing", "--allow-gaps")
    assert dfcgs("encode", tmp_path, tmp_path / "a.dgs", "--allow-gaps", *QUICK).returncode == 0
    assert [f.frame_number for f in probe(tmp_path / "a.dgs").frames] == [0, 1, 3]


def test_repair(tmp_path: Path) -> None:
    cloud = make_cloud(40)
    scales = cloud.scales.copy()
    scales[5, 1] = np.nan
    write_frames(tmp_path, [replace(cloud, scales=scales)])
    words = ("frame_0000.ply", "'scale_1' of Gaussian 5", "--repair")
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, *words)
    done = dfcgs("encode", tmp_path, tmp_path / "a.dgs", "--repair", *QUICK)
    assert done.returncode == 0
    assert "note: frame_0000.ply" in done.stderr


def test_extra_properties(tmp_path: Path) -> None:
    table = ply_table(make_cloud(20))
    wide = np.zeros(len(table), [*table.dtype.descr, ("segment", "<f4")])
    for name in table.dtype.names:
        wide[name] = table[name]
    write_table(tmp_path / "frame_0.ply", wide)
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, "frame_0.ply", "segment", "--drop-extra")
    assert dfcgs("encode", tmp_path, tmp_path / "a.dgs", "--drop-extra", *QUICK).returncode == 0


def test_mixed_sh_degrees(tmp_path: Path) -> None:
    write_frames(tmp_path, [make_cloud(20, 1), make_cloud(20, 2)])
    done = dfcgs("encode", tmp_path, tmp_path / "a.dgs", "--verify", *QUICK)
    assert done.returncode == 0
    assert "note: SH degree 2, but lower in 1 of 2 frames (first frame_0000.ply: 1)" in done.stderr


def test_truncated_frame(tmp_path: Path) -> None:
    write_frames(tmp_path, drifting(make_cloud(40), 3))
    damaged = tmp_path / "frame_0001.ply"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    fails(dfcgs("encode", tmp_path, tmp_path / "a.dgs"), 1, "frame_0001.ply", "truncated")
    assert not (tmp_path / "a.dgs").exists()
    assert not list(tmp_path.glob(".a.dgs*"))


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["--qp", "99"], 1, "0 to 51"),
        (["--qp", "nan"], 1, "0 to 51"),
        (["--gof-size", "0"], 1, "--gof-size 0"),
        (["--jobs", "0"], 1, "--jobs 0"),
        (["--bound", "weight=1"], 1, "known are position"),
        (["--bound", "position=-1"], 1, "above 0"),
        (["--bound", "position"], 2, "position=0.001"),
        (["--fps", "fast"], 2, "30000/1001"),
        (["--quality", "best"], 2, "transparent"),
        (["--pattern", "*.splat"], 1, "no file matches '*.splat'"),
        (["--nonsense"], 2, "--nonsense"),
    ],
)
def test_bad_arguments(frames_dir: Path, tmp_path: Path, arguments: list[str], code: int, word: str) -> None:
    target = tmp_path / "out.dgs"
    fails(dfcgs("encode", frames_dir, target, *arguments), code, word)
    assert not list(tmp_path.iterdir())


def test_missing_folder(tmp_path: Path) -> None:
    fails(dfcgs_process("encode", tmp_path / "none", tmp_path / "a.dgs"), 1, "none does not exist")


def test_nothing_is_overwritten_without_force(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    target.write_bytes(b"precious")
    fails(dfcgs("encode", frames_dir, target), 1, "exists", "--force")
    assert target.read_bytes() == b"precious"
    assert dfcgs("encode", frames_dir, target, "--force", *QUICK).returncode == 0
    assert target.read_bytes()[1:4] == b"DGS"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_interrupt_leaves_nothing_behind(jobs: str, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    write_frames(frames, drifting(real_cloud(4000), 12))
    command = [sys.executable, "-m", "dfcgs_codec", "encode", str(frames), str(tmp_path / "out.dgs")]
    process = subprocess.Popen(
        [*command, "--gof-size", "2", "--qp", "27", "--jobs", jobs], stderr=subprocess.PIPE, text=True
    )
    started = time.monotonic()
    while not list(tmp_path.glob(".out.dgs*")) and time.monotonic() - started < 60:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "interrupted" in message
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_gof_size_is_auto_or_a_number(frames_dir: Path, tmp_path: Path) -> None:
    refused = dfcgs("encode", frames_dir, tmp_path / "a.dgs", "--gof-size", "many")
    assert refused.returncode == 2
    assert "neither auto nor a number" in refused.stderr


def test_a_quality_is_estimated_and_said(frames_dir: Path, tmp_path: Path) -> None:
    for options, psnr in (
        ((), 37),
        (("--quality", "low"), 32),
        (("--quality", "40"), 40),
        (("--psnr", "44.5", "--quality", "low"), 44.5),
    ):
        target = tmp_path / f"{psnr}.dgs"
        done = dfcgs("encode", frames_dir, target, *options)
        assert done.returncode == 0, done.stderr
        (line,) = (line for line in done.stdout.splitlines() if line.startswith("images: about "))
        found = re.fullmatch(r"images: about ([0-9.]+) dB \(estimated\), at QP ([0-9.]+)", line)
        assert found is not None
        assert float(found[1]) == pytest.approx(psnr + 1, abs=1.0)
        said = probe(target).encoder_info
        assert f"quality={psnr:g}dB qp={float(found[2]):.1f}"[:-2] in said
        # the file says what I-frames are expected to be, the report what P-frames seemed beside them too
        in_file = re.search(r"estimate=([0-9.]+)dB$", said)
        assert in_file is not None
        assert float(in_file[1]) == pytest.approx(float(found[1]), abs=1.0)
        assert said in dfcgs("info", target).stdout


def test_a_qp_comes_before_a_quality(frames_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "a.dgs"
    done = dfcgs("encode", frames_dir, target, "--qp", "20", "--psnr", "30", "--quality", "high", "--json")
    found = json.loads(done.stdout)
    assert found["qp"] == 20
    assert found["estimated_psnr"] > 40
    assert found["num_unseen"] is None
    assert "quality" not in probe(target).encoder_info


@pytest.mark.parametrize("psnr", ["14", "71", "nan"])
def test_qualities_out_of_range_are_refused(psnr: str, frames_dir: Path, tmp_path: Path) -> None:
    done = dfcgs("encode", frames_dir, tmp_path / "a.dgs", "--quality", psnr)
    assert done.returncode == 1
    assert f"--quality {psnr}: 15 to 70 dB, or lossless, was expected" in done.stderr
    assert not list(tmp_path.iterdir())


def test_help_shows_what_many_need() -> None:
    short, full = (dfcgs("encode", option).stdout for option in ("--help", "--help-all"))
    groups = re.findall(r"^(\w[\w ]*):$", short, re.MULTILINE)
    assert groups == ["Quality", "Time", "Input", "Output", "Help"]
    shown = set(re.findall(r"^  (?:-\w, )?(--[a-z-]+)", short, re.MULTILINE)) - {"--help", "--help-all"}
    assert len(shown) == 16
    more = set(re.findall(r"^  (?:-\w, )?(--[a-z-]+)", full, re.MULTILINE)) - {"--help", "--help-all"} - shown
    assert more == {"--psnr", "--views-margin", "--keep-unseen", "--bake-filter", "--order", "--profile"}
    assert "--help-all" in short
