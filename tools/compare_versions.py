"""Whether the command line gives the same bytes in two environments with other versions of the dependencies.

    python tools/compare_versions.py .venv/bin/python .venv-oldest/bin/python

Every command runs in both as a user runs it; files and decoded frames are compared. The last line counts.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from dfcgs_codec.ply import read_ply, write_ply

_ROOT = Path(__file__).resolve().parents[1]
_ASSET = _ROOT / "assets" / "playbot_31k_sh2.ply"
_NUM_GAUSSIANS, _NUM_FRAMES = 2000, 4
_ENCODINGS = {
    "default": (),
    "two processes": ("--quality", "high", "--gof-size", "2", "--jobs", "2"),
    "bounded": ("--order", "input", "--bound", "position=0.001", "--bound", "rotation=0.5", "--fps", "29.97"),
    "verbatim": ("--quality", "lossless"),
    "paper": ("--profile", "paper"),
}


def write_frames(folder: Path) -> None:
    """A part of the asset: some of it moves, some of it changes, and the last frame has lost its order."""
    cloud, _ = read_ply(_ASSET)
    cloud = cloud.take(np.linspace(0, cloud.num_gaussians - 1, _NUM_GAUSSIANS).astype(np.int64))
    folder.mkdir()
    for t in range(_NUM_FRAMES):
        cloud.positions[: _NUM_GAUSSIANS // 2, 1] += np.float32(0.01 * t)
        cloud.opacities[::3] += np.float32(0.05)
        order = np.random.default_rng(t).permutation(_NUM_GAUSSIANS) if t == _NUM_FRAMES - 1 else slice(None)
        write_ply(folder / f"frame_{t:04d}.ply", cloud.take(np.arange(_NUM_GAUSSIANS)[order]))


def _dfcgs(python: str, *arguments: str | Path) -> str:
    command = [python, "-m", "dfcgs_codec", *map(str, arguments)]
    # these sources, not those that another environment may have installed
    environment = os.environ | {"PYTHONPATH": str(_ROOT / "src")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")
    return done.stdout


def _digest(paths: list[Path]) -> str:
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths))).hexdigest()


def outcomes(python: str, frames: Path, work: Path) -> dict[str, str]:
    """What each command gives in the environment of `python`: digests, and text that must be the same."""
    found = {}
    for name, options in _ENCODINGS.items():
        stream, decoded = work / f"{name}.dgs", work / name
        _dfcgs(python, "encode", frames, stream, *options, "--quiet")
        _dfcgs(python, "decode", stream, decoded, "--quiet")
        found[f"encode, {name}"] = _digest([stream])
        found[f"decode, {name}"] = _digest(list(decoded.iterdir()))
    found["info"] = _dfcgs(python, "info", work / "default.dgs", "--json", "--chunks")
    for command in ("encode", "decode", "info"):
        # its layout differs between versions of click
        found[f"{command} --help"] = str("Examples:" in _dfcgs(python, command, "--help"))
    return found


def main(reference: str, other: str) -> int:
    """Compare; the number of differences is the exit code."""
    with tempfile.TemporaryDirectory() as name:
        frames = Path(name) / "frames"
        write_frames(frames)
        results = []
        for index, python in enumerate((reference, other)):
            work = Path(name) / str(index)
            work.mkdir()
            results.append(outcomes(python, frames, work))
    expected, found = results
    wrong = [key for key in expected if expected[key] != found[key]]
    for key in wrong:
        print(f"{key}: differs between {reference} and {other}")
    print(f"{len(expected) - len(wrong)} passed, {len(wrong)} failed")
    return len(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
