"""Each PLY file as it is, compressed by zstd: lossless, and what needs no thought at all."""

from __future__ import annotations

from pathlib import Path

import zstandard

from evaluation.baselines.frames import pinned
from evaluation.baselines.method import Method, SequenceFacts, frame_path, frame_paths

REQUIREMENT = "zstandard==0.25.0"
_WRAPPER = 1


def _version() -> str:
    return f"{pinned(REQUIREMENT)} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    del facts
    return None


def _encode(frames: Path, target: Path, setting: str) -> None:
    """`setting` is the level of zstd."""
    pinned(REQUIREMENT)
    compressor = zstandard.ZstdCompressor(level=int(setting))
    for index, path in enumerate(frame_paths(frames)):
        (target / f"frame_{index:04d}.ply.zst").write_bytes(compressor.compress(path.read_bytes()))


def _decode(target: Path, frames: Path) -> None:
    decompressor = zstandard.ZstdDecompressor()
    for index, path in enumerate(sorted(target.glob("frame_*.ply.zst"))):
        frame_path(frames, index).write_bytes(decompressor.decompress(path.read_bytes()))


METHOD = Method("raw_zstd", "PLY + zstd", ("19",), _version, _accepts, _encode, _decode, sample=2)
