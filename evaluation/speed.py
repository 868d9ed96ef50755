"""Encode and decode times on two cores, one run, medians: `python -m evaluation.speed`."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.encoder.frame.segment import SegmentEncoder
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.ply import read_ply
from dfcgs_codec.sequence import MemorySource
from lab.assets import find_asset
from lab.record import write_result
from lab.scenes import VARIANTS, SceneOptions, trained_sequence
from lab.scenes.catalogue import scene as named_scene

QP = 28
_FRAMES = 8
_REPEATS = 3


def decode_times(path: Path) -> list[float]:
    """Seconds to arrays, hash checked, of each frame."""
    times = [time.perf_counter()]
    for frame in decode_sequence(path):
        frame.cloud()
        times.append(time.perf_counter())
    return [after - before for before, after in pairwise(times)]


def _encode_times(frames: list[GaussianCloud], options: EncoderOptions) -> list[float]:
    """Seconds from frame to frame; the last one's errors are measured in its own time."""
    source = MemorySource(frames)
    encoder = SegmentEncoder(source, plan_sequence(source, options))
    moments = [time.perf_counter()]
    encoder.encode(0, len(frames), lambda: moments.append(time.perf_counter()))
    moments[-1] = time.perf_counter()
    return [after - before for before, after in pairwise(moments)]


def measure(frames: list[GaussianCloud], folder: Path) -> dict[str, Any]:
    """Median seconds of I- and P-frames, encode and decode."""
    options = EncoderOptions(qp=QP, gof_size=len(frames))
    path = folder / "speed.dgs"
    encode_sequence(frames, path, options, force=True)
    encode = [_encode_times(frames, options) for _ in range(_REPEATS)]
    decode = [decode_times(path) for _ in range(_REPEATS)]
    info = probe(path)
    return {
        "num_gaussians": frames[0].num_gaussians,
        "sh_degree": frames[0].sh_degree,
        "bytes_i": info.frames[0].num_bytes,
        "bytes_p_median": statistics.median(f.num_bytes for f in info.frames[1:]),
        "encode_i_s": statistics.median(run[0] for run in encode),
        "encode_p_s": statistics.median(t for run in encode for t in run[1:]),
        # control points are chosen and bound with the first P-frame
        "encode_setup_s": _setup(encode),
        "decode_setup_s": _setup(decode),
        "decode_i_s": statistics.median(run[0] for run in decode),
        "decode_p_s": statistics.median(t for run in decode for t in run[1:]),
    }


def _setup(runs: list[list[float]]) -> float:
    """How much longer the first P-frame takes than the others."""
    return statistics.median(run[1] - statistics.median(run[2:]) for run in runs)


def character(num_frames: int = _FRAMES) -> list[GaussianCloud]:
    """A walking character of 200 k Gaussians, SH degree 3: what the paper's times are set beside."""
    scene = replace(named_scene("knight_walk"), num_gaussians=200_000, sh_degree=3)
    return list(islice(scene.frames(find_asset(scene.asset)), num_frames))


def noise_frames(cloud: GaussianCloud) -> list[GaussianCloud]:
    """The worst case of a P-frame: every value takes a random step of about a quantiser step."""
    rng = np.random.default_rng(0)
    sizes = {
        "positions": 5e-4,
        "rotations": 0.01,
        "scales": 0.05,
        "opacities": 0.08,
        "sh_dc": 0.05,
        "sh_rest": 0.05,
    }
    frames = [cloud]
    for _ in range(_FRAMES - 1):
        arrays = {name: getattr(frames[-1], name) for name in sizes}
        moved = {
            name: (values + rng.normal(0, sizes[name], values.shape)).astype(np.float32)
            for name, values in arrays.items()
        }
        frames.append(GaussianCloud(**moved))
    return frames


def _help_time() -> float:
    def once() -> float:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "dfcgs_codec", "--help"], capture_output=True, check=True)
        return time.perf_counter() - start

    return statistics.median(once() for _ in range(7))


def main() -> None:
    """Measure and write the result."""
    cloud, _ = read_ply(find_asset("playbot_125k_sh2.ply", "playbot_31k_sh2.ply"))

    def clean() -> Iterator[GaussianCloud]:
        return trained_sequence(cloud, SceneOptions(_FRAMES), "sway")

    results: dict[str, Any] = {"help_s": _help_time()}
    with tempfile.TemporaryDirectory() as folder:
        sequences = {
            "tracked": VARIANTS["noisy"](clean(), 0),
            "all_attributes_drift": VARIANTS["drift"](clean(), 0),
            "all_attributes_noise": noise_frames(cloud),
            "static": VARIANTS["static"](clean(), 0),
            "character_200k": character(),
        }
        for name, sequence in sequences.items():
            frames = list(sequence)
            results[name] = measure(frames, Path(folder))
            print(name, {k: round(v, 3) for k, v in results[name].items()})
    conditions = {
        "qp": QP,
        "repeats": _REPEATS,
        "frames": _FRAMES,
        "to": "arrays, hash checked",
    }
    print(write_result("speed", conditions, results))


if __name__ == "__main__":
    main()
