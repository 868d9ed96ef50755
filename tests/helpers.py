"""Deterministic clouds and sequences, and `check_*` functions that several tests share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from plyfile import PlyData, PlyElement
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import MAGIC, ChunkType
from dfcgs_codec.bitstream.container import ContainerReader, write_chunk
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader
from dfcgs_codec.bitstream.index import Index, IndexEntry
from dfcgs_codec.bitstream.io import ByteWriter
from dfcgs_codec.codec.decoder import DecodedFrame
from dfcgs_codec.codec.symbol_reader import SymbolReader
from dfcgs_codec.codec.symbols import SymbolCoder
from dfcgs_codec.encoder.report import EncodeReport
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from dfcgs_codec.ply import property_names, read_ply

ROOT = Path(__file__).resolve().parents[1]
ASSET = ROOT / "assets" / "playbot_31k_sh2.ply"
FIELDS = ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest")
#: the 24 turns that carry a Gaussian's axes onto its axes
OCTAHEDRAL = Rotation.create_group("O")

Int64 = npt.NDArray[np.int64]
_T = TypeVar("_T")


# --- clouds -------------------------------------------------------------------------------------------


def make_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """Independent Gaussians in a ball of radius about 2, sizes around exp(-4)."""
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> npt.NDArray[np.float32]:
        return rng.normal(size=shape).astype(np.float32)

    return GaussianCloud(
        positions=normal(n, 3),
        rotations=normal(n, 4),
        scales=normal(n, 3) * np.float32(0.5) - 4,
        opacities=normal(n) * 2,
        sh_dc=normal(n, 3),
        sh_rest=normal(n, 3, SH_REST_COEFFICIENTS[sh_degree]) * np.float32(0.1),
    )


def clustered_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """A few dense clusters whose members resemble each other, as in trained scenes."""
    rng = np.random.default_rng(seed)
    centers, own = make_cloud(8, sh_degree, seed), make_cloud(n, sh_degree, seed + 1)
    cluster = centers.take(rng.integers(0, 8, n))
    mixed = {f: getattr(cluster, f) + np.float32(0.1) * getattr(own, f) for f in FIELDS}
    return replace(GaussianCloud(**mixed), scales=cluster.scales + np.float32(0.1) * (own.scales + 4))


def coincident_cloud(n: int, sh_degree: int = 0, seed: int = 0) -> GaussianCloud:
    """All Gaussians at one point."""
    cloud = make_cloud(n, sh_degree, seed)
    return replace(cloud, positions=np.full((n, 3), 0.25, np.float32))


def with_outliers(cloud: GaussianCloud, count: int, factor: float = 1000.0) -> GaussianCloud:
    """The first `count` Gaussians are `factor` times as far out."""
    positions = cloud.positions.copy()
    positions[:count] *= np.float32(factor)
    return replace(cloud, positions=positions)


@cache
def _asset() -> GaussianCloud:
    return read_ply(ASSET)[0]


def real_cloud(n: int) -> GaussianCloud:
    """Every k-th Gaussian of the asset."""
    cloud = _asset()
    return cloud.take(np.linspace(0, cloud.num_gaussians - 1, n).astype(np.int64))


def on_lattices(cloud: GaussianCloud) -> GaussianCloud:
    """As SPZ leaves it."""
    steps = {"positions": 2.0**-12, "scales": 2.0**-4, "sh_rest": 2.0**-4}
    arrays = {name: np.rint(getattr(cloud, name) / step) * step for name, step in steps.items()}
    return replace(cloud, **{name: array.astype(np.float32) for name, array in arrays.items()})


def same_cloud(a: GaussianCloud, b: GaussianCloud) -> bool:
    """Equal bit for bit."""
    return all(getattr(a, f).tobytes() == getattr(b, f).tobytes() for f in FIELDS)


# --- sequences ----------------------------------------------------------------------------------------


def swaying(cloud: GaussianCloud, count: int, amount: float = 0.04) -> list[GaussianCloud]:
    """Everything leans to one side, the farther up the more, and back."""
    up = cloud.positions[:, 1] - cloud.positions[:, 1].min()
    frames = []
    for index in range(count):
        positions = cloud.positions.copy()
        positions[:, 0] += np.float32(amount * np.sin(index)) * up
        frames.append(replace(cloud, positions=positions))
    return frames


def still(cloud: GaussianCloud, num_frames: int) -> list[GaussianCloud]:
    """The same frame again and again."""
    return [cloud] * num_frames


def drifting(cloud: GaussianCloud, num_frames: int, speed: float = 0.01) -> list[GaussianCloud]:
    """A tracked sequence: all Gaussians with x > 0 move along y, the others stand still."""
    moving = cloud.positions[:, :1] > 0
    step = np.array([0, speed, 0], np.float32)
    return [
        replace(cloud, positions=np.where(moving, cloud.positions + step * np.float32(i), cloud.positions))
        for i in range(num_frames)
    ]


def waving(cloud: GaussianCloud, angle: float) -> GaussianCloud:
    """The Gaussians with x > 0.2 turned by `angle` radians about the vertical axis."""
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    moving = cloud.positions[:, :1] > 0.2
    turned = turn * Rotation.from_quat(cloud.rotations, scalar_first=True)
    return replace(
        cloud,
        positions=np.where(moving, turn.apply(cloud.positions), cloud.positions).astype(np.float32),
        rotations=np.where(moving, turned.as_quat(scalar_first=True), cloud.rotations).astype(np.float32),
    )


def joined(first: GaussianCloud, second: GaussianCloud) -> GaussianCloud:
    """All Gaussians of both."""
    return GaussianCloud(**{f: np.concatenate([getattr(first, f), getattr(second, f)]) for f in FIELDS})


def succeeding(
    cloud: GaussianCloud, num_frames: int, *, angle: float = 0.05, share: float = 0.03, shuffle: bool = False
) -> list[GaussianCloud]:
    """Part of the Gaussians turns; with each frame a share goes and as many others come."""
    rng = np.random.default_rng(num_frames)
    count = max(1, round(share * cloud.num_gaussians))
    frames = [cloud]
    for index in range(1, num_frames):
        kept = np.sort(rng.permutation(cloud.num_gaussians)[count:])
        fresh = make_cloud(count, cloud.sh_degree, 1000 + index)
        fresh = replace(fresh, scales=fresh.scales + (cloud.scales.mean() + 4))
        cloud = joined(waving(cloud.take(kept), angle), fresh)
        frames.append(cloud.take(rng.permutation(cloud.num_gaussians)) if shuffle else cloud)
    return frames


def travelling(cloud: GaussianCloud, num_frames: int, speed: float = 0.1) -> list[GaussianCloud]:
    """A tracked sequence in which the whole scene moves along x, far beyond its own size in the end."""
    step = np.array([speed, 0, 0], np.float32)
    return [replace(cloud, positions=cloud.positions + step * np.float32(i)) for i in range(num_frames)]


def all_changing(cloud: GaussianCloud, num_frames: int, seed: int = 5) -> list[GaussianCloud]:
    """A semi-tracked sequence: every attribute of every Gaussian walks at random."""
    frames = [cloud]
    for i in range(1, num_frames):
        noise, last = make_cloud(cloud.num_gaussians, cloud.sh_degree, seed + i), frames[-1]
        moved = {f: getattr(last, f) + np.float32(0.02) * getattr(noise, f) for f in FIELDS}
        moved["scales"] = last.scales + np.float32(0.02) * (noise.scales + 4)
        frames.append(GaussianCloud(**moved))
    return frames


def untracked(n: int, num_frames: int, sh_degree: int = 0) -> list[GaussianCloud]:
    """Nothing corresponds."""
    return [make_cloud(n, sh_degree, 100 + i) for i in range(num_frames)]


def shuffled(cloud: GaussianCloud, seed: int = 3) -> GaussianCloud:
    """The same Gaussians in another order."""
    return cloud.take(np.random.default_rng(seed).permutation(cloud.num_gaussians))


# --- encode and decode --------------------------------------------------------------------------------


def encode(
    frames: Sequence[GaussianCloud] | Path, path: Path, options: EncoderOptions | None = None
) -> EncodeReport:
    """Encode to `path`, whatever was there."""
    return encode_sequence(frames, path, options, force=True)


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


def covariances(cloud: GaussianCloud) -> npt.NDArray[np.float64]:
    """Covariance (N, 3, 3) of each Gaussian."""
    axes = turns(cloud).as_matrix() * np.exp(cloud.scales.astype(np.float64))[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def alphas(cloud: GaussianCloud) -> npt.NDArray[np.float64]:
    """Opacity of each Gaussian, 0 to 1."""
    return 1 / (1 + np.exp(-cloud.opacities.astype(np.float64)))


def match(source: GaussianCloud, decoded: GaussianCloud) -> Int64:
    """For each decoded Gaussian the nearest source Gaussian; every one of them is somebody's."""
    index = cKDTree(source.positions).query(decoded.positions)[1]
    assert np.array_equal(np.sort(index), np.arange(source.num_gaussians))
    return index


def rotation_degrees(source: GaussianCloud, decoded: GaussianCloud) -> npt.NDArray[np.float64]:
    """Angle between equal indices, the names of the axes being the same."""
    return np.degrees((turns(source).inv() * turns(decoded)).magnitude())


def shape_errors(
    source: GaussianCloud, decoded: GaussianCloud
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
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
    """`dfcgs` in a fresh process."""
    return run_python("-m", "dfcgs_codec", *map(str, arguments))


# --- taking files apart -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chunk:
    """Type, frame index and payload, for building other files."""

    chunk_type: int
    frame_index: int
    payload: bytes


def split_chunks(data: bytes) -> list[Chunk]:
    """All known chunks of a file, the sequence header first, without INDEX and END."""
    container = ContainerReader(BytesIO(data))
    heads = [container.sequence_head, *container.chunks()]
    kept = [h for h in heads if h.chunk_type not in (ChunkType.INDEX, ChunkType.END)]
    return [Chunk(h.chunk_type, h.frame_index, container.payload(h).raw(h.payload_length)) for h in kept]


def join_chunks(chunks: Sequence[Chunk], *, index: bytes | None = None, magic: bytes = MAGIC) -> bytes:
    """A file of these chunks with right checksums, an index (`index` replaces its payload) and an end."""
    data = magic
    starts: list[tuple[int, int]] = []
    for chunk in chunks:
        if chunk.chunk_type == ChunkType.INTRA_FRAME:
            starts.append((chunk.frame_index, len(data)))
        data += write_chunk(chunk.chunk_type, chunk.frame_index, chunk.payload)
    frames = [c.frame_index for c in chunks if c.chunk_type in (ChunkType.INTRA_FRAME, ChunkType.INTER_FRAME)]
    if index is None:
        writer = ByteWriter()
        ends = [first for first, _ in starts[1:]] + [max(frames, default=-1) + 1]
        entries = [IndexEntry(first, end - first, at) for (first, at), end in zip(starts, ends, strict=False)]
        Index(tuple(entries)).write(writer)
        index = writer.getvalue()
    end = len(data).to_bytes(8, "little")
    return data + write_chunk(ChunkType.INDEX, 0, index) + write_chunk(ChunkType.END, 0, end)
