"""SPZ version 4, all Gaussians of GOF_SIZE frames concatenated into one file.

SPZ stores attribute by attribute and compresses each with zstd, so that repeated frames are found again as
long as they fit into its window. It keeps the order, so that N of each frame, in a file of its own, splits
them again. Losses are those of `spz`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import write_ply
from evaluation.baselines import spz
from evaluation.baselines.frames import concatenated, read_frames, write_frames
from evaluation.baselines.method import Method
from evaluation.baselines.spz_frames import accepts, encode_ply, version

GOF_SIZE = 10
#: N of every frame, little-endian u32
_COUNTS = "counts.u32"


def _encode(frames: Path, target: Path, setting: str) -> None:
    del setting
    clouds, counts = read_frames(frames), []
    with tempfile.TemporaryDirectory() as scratch:
        joined = Path(scratch) / "gof.ply"
        while gof := list(islice(clouds, GOF_SIZE)):
            write_ply(joined, concatenated(gof))
            encode_ply(joined, target / f"gof_{len(counts) // GOF_SIZE:04d}.spz")
            counts += [cloud.num_gaussians for cloud in gof]
    (target / _COUNTS).write_bytes(np.array(counts, "<u4").tobytes())


def _clouds(target: Path) -> Iterator[GaussianCloud]:
    counts = np.frombuffer((target / _COUNTS).read_bytes(), "<u4").astype(np.int64)
    for index, path in enumerate(sorted(target.glob("gof_*.spz"))):
        joined = spz.decode(path)
        ends = np.cumsum(counts[index * GOF_SIZE : (index + 1) * GOF_SIZE])
        for part in np.split(np.arange(joined.num_gaussians), ends[:-1]):
            yield joined.take(part)


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds(target))


METHOD = Method("spz_gof", "SPZ, 10 frames joined", ("v4",), version, accepts, _encode, _decode)
