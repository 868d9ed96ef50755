"""One sequence through `dfcgs encode` and `dfcgs decode` in fresh processes, as a user runs them."""

from __future__ import annotations

import resource
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from dfcgs_codec import GaussianCloud, probe
from dfcgs_codec.files import FRAME_NAME
from dfcgs_codec.ply import read_ply, write_ply
from evaluation.fresh import Run, run_fresh
from lab.quality import FrameQuality, frame_quality, image
from lab.render import Camera, orbit
from lab.views import central_box

SIZE = (320, 240)
VERTICAL_FOV = 50.0
#: azimuth and elevation of each view, degrees
ANGLES = ((20.0, 10.0), (140.0, 35.0), (260.0, -10.0))


class RoundTripError(Exception):
    """`dfcgs` ended with an error; its message says which."""


@dataclass(frozen=True)
class RoundTrip:
    """A coded and decoded sequence; every list has one entry per repetition.

    frame_types: one letter per frame: I, P, or s for a frame that repeats the one before.
    *_s: seconds of the whole process; *_cpu_s: processor seconds of it and its children.
    note: the last line that encode printed on stderr.
    """

    num_bytes: int
    frame_types: str
    encode_s: list[float]
    encode_cpu_s: list[float]
    decode_s: list[float]
    decode_cpu_s: list[float]
    note: str


def write_frames(frames: Iterator[GaussianCloud], folder: Path) -> dict[Path, int]:
    """The frames as numbered PLYs in a new folder: their paths in order, and their numbers of Gaussians."""
    folder.mkdir()
    counts = {}
    for index, cloud in enumerate(frames):
        path = folder / FRAME_NAME.format(index)
        write_ply(path, cloud)
        counts[path] = cloud.num_gaussians
    return counts


def _children_cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _repeated(arguments: list[str], repeats: int) -> tuple[list[float], list[float], Run]:
    """Wall-clock and processor seconds of each run, and the last run."""
    seconds, cpu = [], [_children_cpu()]
    for _ in range(repeats):
        run = run_fresh([sys.executable, "-m", "dfcgs_codec", *arguments, "--quiet", "--force"])
        if run.exit_code:
            raise RoundTripError(f"{arguments[0]} ended with {run.exit_code}: {run.message}")
        seconds.append(round(run.seconds, 3))
        cpu.append(_children_cpu())
    return seconds, [round(after - before, 3) for before, after in pairwise(cpu)], run


def round_trip(source: Path, decoded: Path, options: tuple[str, ...] = (), repeats: int = 1) -> RoundTrip:
    """Encode the folder `source` and decode it to the folder `decoded`, every frame's hash checked by decode.

    Raises RoundTripError where either refuses.
    """
    file = decoded.with_suffix(".dgs")
    encode_s, encode_cpu, encoded = _repeated(["encode", str(source), str(file), *options], repeats)
    decode_s, decode_cpu, _ = _repeated(["decode", str(file), str(decoded)], repeats)
    kinds = "".join(frame.frame_type[0] for frame in probe(file).frames)
    return RoundTrip(file.stat().st_size, kinds, encode_s, encode_cpu, decode_s, decode_cpu, encoded.message)


def view_radius(first: GaussianCloud) -> float:
    """Radius, scene units, of the sphere that the views show: around the box, or a few Gaussians."""
    extent = 3.0 * float(np.exp(np.median(first.scales.max(axis=1))))
    return max(0.5 * float(np.linalg.norm(np.ptp(central_box(first), axis=0))), extent)


def views(cloud: GaussianCloud, radius: float) -> list[Camera]:
    """Cameras around the middle of this frame's box, so that an object that moves away stays in sight."""
    distance = radius / np.sin(np.radians(VERTICAL_FOV / 2))
    middle = central_box(cloud).mean(axis=0).tolist()
    return [orbit(middle, distance, angles, SIZE, VERTICAL_FOV) for angles in ANGLES]


def compare(sources: list[Path], folders: list[Path]) -> list[list[FrameQuality]]:
    """Identical-source quality of every frame in each of the decoded `folders`, then removes these."""
    radius = view_radius(read_ply(sources[0])[0])
    rated: list[list[FrameQuality]] = [[] for _ in folders]
    for index, path in enumerate(sources):
        cloud, _ = read_ply(path)
        cameras = views(cloud, radius)
        images = [image(cloud, camera) for camera in cameras]
        for frames, folder in zip(rated, folders, strict=True):
            frames.append(frame_quality(index, images, read_ply(folder / path.name)[0], cameras))
    for folder in folders:
        shutil.rmtree(folder)
    return rated
