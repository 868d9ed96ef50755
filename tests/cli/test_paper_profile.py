"""`dfcgs encode --profile paper` as a user types it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.small_clouds import real_cloud, swaying
from tests.helpers import dfcgs, write_frames


@pytest.fixture(scope="module")
def swaying_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames that sway, the last one brighter."""
    frames = swaying(real_cloud(2000), 4, 0.1)
    frames[3] = replace(frames[3], sh_dc=frames[3].sh_dc + np.float32(0.3))
    return write_frames(tmp_path_factory.mktemp("swaying"), frames)


def test_encode_verify_info(swaying_dir: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.dgs"
    done = dfcgs("encode", swaying_dir, target, "--profile", "paper", "--verify", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["verified"]
    kinds = [frame["kind"] for frame in report["frames"]]
    # a frame that motion leads no nearer is the one before
    assert (kinds[:2], "I" in kinds[1:]) == (["I", "P"], False)
    assert "what else changed in 1 frames" in done.stderr
    found = json.loads(dfcgs("info", target, "--json").stdout)
    assert (found["profile"], found["model_id"]) == ("paper", "paper-1")
    for kind in ("HYPERPRIOR", "MOTION"):
        assert found["bytes_by_attribute"][kind] == found["bytes_by_chunk_type"][kind] > 0
    assert "profile=paper model=paper-1" in found["encoder_info"]
    text = dfcgs("info", target).stdout
    assert "profile paper, model paper-1" in text


def test_no_error_can_be_bounded(swaying_dir: Path, tmp_path: Path) -> None:
    bound = ("--bound", "position=0.1")
    done = dfcgs("encode", swaying_dir, tmp_path / "out.dgs", "--profile", "paper", *bound)
    assert done.returncode == 1
    assert "--profile paper" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out.dgs").exists()
