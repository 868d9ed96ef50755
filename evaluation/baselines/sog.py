"""SOG, a file per frame, by PlayCanvas' splat-transform: images of quantised attributes, palettes, WebP.

Precision is the format's: 16-bit positions on a logarithmic scale over the bounding box, codebooks of 256
values for scales, colours and SH, 8-bit alpha (1 comes back as 0.996), 8 bits for three quaternion components
(up to 1.6 degrees), and SH as a palette of at most 65536 vectors found by k-means (10 iterations, the tool's
default) from a random start: bytes differ a little from run to run. Gaussians come back in its Morton order.

Without a GPU the k-means takes minutes beyond MAX_GAUSSIANS, so that larger content is refused.

Install it beside the repository's other build products, where it is looked for before the path:

    npm install --prefix out/tools/splat-transform @playcanvas/splat-transform@2.7.1
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply
from evaluation.baselines.frames import write_frames
from evaluation.baselines.method import (
    Method,
    MethodRefused,
    MethodUnavailable,
    SequenceFacts,
    frame_paths,
)

#: the last series that runs on node 18 and 20
VERSION = "2.7.1"
MAX_GAUSSIANS = 40_000
_WRAPPER = 1
_PREFIX = "out/tools/splat-transform"
_PROGRAM = Path(__file__).parents[2] / _PREFIX / "node_modules/.bin/splat-transform"
_INSTALL = f"npm install --prefix {_PREFIX} @playcanvas/splat-transform@{VERSION}"


def _program() -> str:
    found = shutil.which(str(_PROGRAM)) or shutil.which("splat-transform")
    if found is None or shutil.which("node") is None:
        raise MethodUnavailable(f"splat-transform is missing: install node 18 or later, then {_INSTALL}")
    done = subprocess.run([found, "--version"], capture_output=True, text=True, check=False)
    told = done.stdout + done.stderr
    if f"v{VERSION}" not in told.split():
        raise MethodUnavailable(f"found {told.strip() or 'no splat-transform that runs'}: {_INSTALL}")
    return found


def _convert(program: str, source: Path, target: Path) -> None:
    command = [program, "--quiet", "--overwrite", "--gpu", "cpu", str(source), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not target.exists():
        raise MethodRefused(f"splat-transform: {(done.stderr or done.stdout).strip()}")


def _version() -> str:
    _program()
    return f"splat-transform {VERSION} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    if max(facts.num_gaussians) > MAX_GAUSSIANS:
        return f"takes minutes per frame without a GPU beyond {MAX_GAUSSIANS} Gaussians"
    return None


def _encode(frames: Path, target: Path, setting: str) -> None:
    del setting
    program = _program()
    for index, path in enumerate(frame_paths(frames)):
        _convert(program, path, target / f"frame_{index:04d}.sog")


def _clouds(target: Path) -> Iterator[GaussianCloud]:
    program = _program()
    with tempfile.TemporaryDirectory() as scratch:
        ply = Path(scratch) / "frame.ply"
        for path in sorted(target.glob("frame_*.sog")):
            _convert(program, path, ply)
            yield read_ply(ply)[0]


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds(target))


METHOD = Method("sog", "SOG per frame", ("default",), _version, _accepts, _encode, _decode, sample=1)
