"""splats4d (`.splat4d`), a native encoder of `.splat` sequences with hard error bounds.

Through its own command line; what the PLY loses on the way to `.splat` is in `dot_splat`. Content with SH
above degree 0 is refused, and so is a change of N. Settings:

    default  the tool's own bounds: 2 mm (a scene unit counts as a metre), 4 colour levels, 2 % scale, zstd 3
    mm0.25   0.25 mm, 1 colour level, 0.25 % scale, zstd level 19
    qpNN     bounds as near as can be to half the codec's steps at that QP, which follow the sizes of the
             first frame's Gaussians; zstd level 19

Keyframes at the tool's default distance of 30 frames. Gaussians come back in an order of its own.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.encoder.plan.quantiser_steps import SH_C0
from dfcgs_codec.gaussians import GaussianCloud
from evaluation.baselines.delta_symbols import rotation_step
from evaluation.baselines.dot_splat import read_splat, unit_rotations, write_splat
from evaluation.baselines.frames import pinned, planned, planned_version, read_frames, write_frames
from evaluation.baselines.method import Method, MethodRefused, MethodUnavailable, SequenceFacts

REQUIREMENT = "splats4d==0.1.0"
_WRAPPER = 1
_FILE = "sequence.splat4d"
_DEFAULT = "default"
_FINE = ["--pos-mm", "0.25", "--color-levels", "1", "--scale-pct", "0.25", "--zstd-level", "19"]


def _program() -> str:
    pinned(REQUIREMENT)
    found = shutil.which("splat4d", path=str(Path(sys.executable).parent)) or shutil.which("splat4d")
    if found is None:
        raise MethodUnavailable(f"splat4d is not on the path: pip install --force-reinstall {REQUIREMENT}")
    return found


def _run(*arguments: str | Path) -> None:
    done = subprocess.run([_program(), *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise MethodRefused(
            f"splat4d {arguments[0]}: {(done.stderr or done.stdout).strip().splitlines()[:1]}"
        )


def _version() -> str:
    _program()
    return f"{REQUIREMENT} {planned_version()} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    if facts.sh_degree:
        return "drops SH"
    return None if facts.constant_count else "needs the same N in all frames"


def _options(setting: str, first: GaussianCloud) -> list[str]:
    if setting == _DEFAULT:
        return []
    if setting == "mm0.25":
        return _FINE
    plan = planned(float(setting.removeprefix("qp")), first)
    half = {a: 0.5 * step for a, step in plan.steps.items()}
    rotation = 0.5 * rotation_step(plan.steps)
    position = half[Attribute.POSITION] * 2.0**plan.units.position
    colour = half[Attribute.SH_DC] * 2.0**plan.units.color * SH_C0
    return [
        f"--pos-mm={1000 * position:.6g}",
        f"--color-levels={round(255 * colour)}",
        f"--scale-pct={100 * half[Attribute.SCALE] * 2.0**plan.units.scale:.6g}",
        f"--rot-steps={round(128 * rotation)}",
        "--zstd-level=19",
    ]


def _encode(frames: Path, target: Path, setting: str) -> None:
    options = _options(setting, next(read_frames(frames)))
    with tempfile.TemporaryDirectory() as scratch:
        rotations = None
        for index, cloud in enumerate(read_frames(frames)):
            rotations = unit_rotations(cloud.rotations, rotations)
            write_splat(Path(scratch) / f"frame_{index:04d}.splat", cloud, rotations)
        _run("encode", "-i", scratch, "-o", target / _FILE, *options)
    # frames are asked for one by one, and the tool does not tell how many there are but in prose
    (target / "frames.u32").write_bytes((index + 1).to_bytes(4, "little"))


def _clouds(target: Path) -> Iterator[GaussianCloud]:
    count = int.from_bytes((target / "frames.u32").read_bytes(), "little")
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "frame.splat"
        for index in range(count):
            _run("decode", target / _FILE, "--frame", str(index), "-o", path)
            yield read_splat(path)


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds(target))


_SETTINGS = ("mm0.25", "qp16", "qp22", "qp28", "qp34", _DEFAULT)
METHOD = Method("splats4d", "splats4d", _SETTINGS, _version, _accepts, _encode, _decode)
