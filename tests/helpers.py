"""What several tests share: encoding, decoding, tables of PLY files, comparisons, processes."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pytest
from plyfile import PlyData, PlyElement
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.bitstream.container import ContainerReader
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.frame.decoder import DecodedFrame
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.ply import property_names
from tests.troubles.situations import run

ROOT = Path(__file__).resolve().parents[1]
#: the 24 turns that carry a Gaussian's axes onto its axes
OCTAHEDRAL = Rotation.create_group("O")

#: a medium quality, or nearly so, without the search for it
QUICK = EncoderOptions(qp=27)

_T = TypeVar("_T")


def taking_turns(first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
    """All pairs for `parametrize`; each of `first` with one of `second` in turn, the others are slow."""
    return [
        pytest.param(a, b, marks=() if turn == place % len(second) else pytest.mark.slow)
        for place, a in enumerate(first)
        for turn, b in enumerate(second)
    ]


# --- encode and decode --------------------------------------------------------------------------------


def encode(
    frames: Sequence[GaussianCloud] | Path, path: Path, options: EncoderOptions | None = None
) -> EncodeReport:
    """Encode to `path`, whatever was there."""
    return encode_sequence(frames, path, options or QUICK, force=True)


def decode(path: Path, start: int = 0, stop: int | None = None) -> list[DecodedFrame]:
    """All frames, hashes checked."""
    return list(decode_sequence(path, start, stop))


def round_trip(
    frames: Sequence[GaussianCloud], path: Path, options: EncoderOptions | None = None
) -> list[GaussianCloud]:
    """Decoded clouds of encoded `frames`."""
    encode(frames, path, options)
    return [frame.cloud() for frame in decode(path)]


def frame_hashes(path: Path) -> list[bytes]:
    """Hashes that the encoder wrote into the frame headers."""
    hashes = []
    with path.open("rb") as file:
        container = ContainerReader(file)
        for head in container.chunks():
            if head.chunk_type == ChunkType.INTRA_FRAME:
                hashes.append(IntraHeader.read(container.payload(head), container.sequence).frame_hash)
            elif head.chunk_type == ChunkType.INTER_FRAME:
                hashes.append(InterHeader.read(container.payload(head), container.sequence).frame_hash)
    return hashes


def chunk_types(path: Path) -> list[int]:
    """Types of the known chunks after the sequence header."""
    with path.open("rb") as file:
        return [head.chunk_type for head in ContainerReader(file).chunks()]


def check_walk(code: Callable[[SymbolCoder, bool], _T], same: Callable[[_T, _T], bool]) -> int:
    """`code(coder, writing)` gives the same with a writer and then a reader; returns bytes."""
    writer = SymbolWriter()
    written = code(writer, True)
    data = writer.getvalue()
    reader = SymbolReader(data)
    read = code(reader, False)
    reader.finish()
    assert same(written, read)
    return len(data)


# --- PLY ----------------------------------------------------------------------------------------------


def ply_table(cloud: GaussianCloud) -> npt.NDArray[np.void]:
    """The cloud as a structured array in the INRIA property order."""
    n = cloud.num_gaussians
    columns = [
        cloud.positions,
        np.zeros((n, 3), np.float32),
        cloud.sh_dc,
        cloud.sh_rest.reshape(n, cloud.sh_rest.shape[2] * 3),
        cloud.opacities[:, None],
        cloud.scales,
        cloud.rotations,
    ]
    names = property_names(cloud.sh_degree)
    table = np.zeros(n, [(name, "<f4") for name in names])
    for name, column in zip(names, np.concatenate(columns, axis=1).T, strict=True):
        table[name] = column
    return table


def write_table(
    path: Path, table: npt.NDArray[np.void], *, text: bool = False, byte_order: str = "<"
) -> Path:
    """A PLY with whatever properties `table` has."""
    path.parent.mkdir(parents=True, exist_ok=True)
    PlyData([PlyElement.describe(table, "vertex")], text=text, byte_order=byte_order).write(str(path))
    return path


def write_frames(
    folder: Path, frames: Iterable[GaussianCloud], name: str = "frame_{:04d}.ply", first: int = 0
) -> Path:
    """A folder of PLY frames; `name` may contain folders."""
    for number, frame in enumerate(frames, first):
        write_table(folder / name.format(number), ply_table(frame))
    return folder


# --- comparisons --------------------------------------------------------------------------------------


def turns(cloud: GaussianCloud) -> Rotation:
    """Rotations of a cloud; scipy puts w last."""
    return Rotation.from_quat(cloud.rotations.astype(np.float64)[:, [1, 2, 3, 0]])


def covariances(cloud: GaussianCloud) -> Float64:
    """Covariance (N, 3, 3) of each Gaussian."""
    axes = turns(cloud).as_matrix() * np.exp(cloud.scales.astype(np.float64))[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def alphas(cloud: GaussianCloud) -> Float64:
    """Opacity of each Gaussian, 0 to 1."""
    return 1 / (1 + np.exp(-cloud.opacities.astype(np.float64)))


def match(source: GaussianCloud, decoded: GaussianCloud) -> Int64:
    """For each decoded Gaussian the nearest source Gaussian; every one of them is somebody's."""
    index = cKDTree(source.positions).query(decoded.positions)[1]
    assert np.array_equal(np.sort(index), np.arange(source.num_gaussians))
    return index


def rotation_degrees(source: GaussianCloud, decoded: GaussianCloud) -> Float64:
    """Angle between equal indices, the names of the axes being the same."""
    return np.degrees((turns(source).inv() * turns(decoded)).magnitude())


def shape_errors(source: GaussianCloud, decoded: GaussianCloud) -> tuple[Float64, Float64]:
    """Angle in degrees (N,) and log-scale error (N, 3), whatever the axes are called."""
    relative = turns(source).inv() * turns(decoded)
    angles = np.stack([(relative * turn.inv()).magnitude() for turn in OCTAHEDRAL])
    best = angles.argmin(axis=0)
    axes = np.abs(OCTAHEDRAL.as_matrix()).argmax(axis=1)[best]
    named = np.take_along_axis(source.scales, axes, axis=1).astype(np.float64)
    return np.degrees(angles.min(axis=0)), np.abs(named - decoded.scales)


# --- processes ----------------------------------------------------------------------------------------


def run_python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter."""
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def dfcgs(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`dfcgs` in this process, which takes no longer than the work itself.

    A warning of numpy's, which a user would read, is an error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        return subprocess.CompletedProcess(arguments, *run(*arguments))


def dfcgs_process(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`dfcgs` in a fresh process."""
    return run_python("-m", "dfcgs_codec", *map(str, arguments))
