"""Write the conformance streams: `make golden`.

Valid streams with the hash and the PLY bytes of every frame, faulty ones with the error that refuses them.
Released streams are frozen: existing files are only replaced with --new-version, which belongs to a new
version of the bitstream.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import BITSTREAM_VERSION, ChunkType, IntraKind, OutputOrder
from dfcgs_codec.ply import write_ply

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from tests import helpers  # noqa: E402

FOLDER = ROOT / "tests" / "conformance"
Sequence = tuple[list[GaussianCloud], EncoderOptions]


def _flipping_signs() -> list[GaussianCloud]:
    cloud = helpers.real_cloud(60)
    return [replace(cloud, rotations=cloud.rotations * np.float32((-1) ** i)) for i in range(3)]


def valid_sequences() -> dict[str, Sequence]:
    """What the valid streams are made of; each shows one part of the format."""
    real = helpers.real_cloud(120)
    return {
        "tracked_sh2": (helpers.drifting(real, 4), EncoderOptions(gof_size=3)),
        "all_attributes_sh3": (helpers.all_changing(helpers.make_cloud(60, 3), 3), EncoderOptions()),
        "skipped_frames_sh0": (helpers.still(helpers.make_cloud(50), 4), EncoderOptions()),
        "input_order_sh1": (
            helpers.drifting(helpers.make_cloud(70, 1), 3),
            EncoderOptions(order=OutputOrder.INPUT, gof_size=2),
        ),
        "single_gaussian": (helpers.drifting(helpers.make_cloud(1), 3), EncoderOptions()),
        "coincident": (helpers.travelling(helpers.coincident_cloud(80), 2), EncoderOptions()),
        "far_outliers": (
            [helpers.with_outliers(helpers.make_cloud(90), 4, 1e6)],
            EncoderOptions(qp=4, order=OutputOrder.FREE),
        ),
        "changed_count": ([helpers.make_cloud(40), helpers.make_cloud(30, 0, 9)], EncoderOptions()),
        "verbatim_sh1": (
            helpers.drifting(helpers.make_cloud(50, 1), 3),
            EncoderOptions(intra=IntraKind.PLY, order=OutputOrder.INPUT),
        ),
        "sign_flips": (_flipping_signs(), EncoderOptions(keep_axes=True)),
    }


def _chunks_with(data: bytes, change: Callable[[helpers.Chunk], helpers.Chunk]) -> bytes:
    """The file with every chunk changed, checksums and index right again."""
    return helpers.join_chunks([change(chunk) for chunk in helpers.split_chunks(data)])


def _in_chunk(chunk_type: ChunkType, position: int, value: int) -> Callable[[helpers.Chunk], helpers.Chunk]:
    """Replace one payload byte of every chunk of a type."""

    def change(chunk: helpers.Chunk) -> helpers.Chunk:
        if chunk.chunk_type != chunk_type:
            return chunk
        payload = bytearray(chunk.payload)
        payload[position] = value
        return replace(chunk, payload=bytes(payload))

    return change


def _with_chunk(data: bytes, chunk_type: int) -> bytes:
    chunks = helpers.split_chunks(data)
    return helpers.join_chunks([chunks[0], helpers.Chunk(chunk_type, 0, b"of another time"), *chunks[1:]])


def _without_intra(data: bytes) -> bytes:
    kept = [c for c in helpers.split_chunks(data) if c.chunk_type != ChunkType.INTRA_FRAME]
    return helpers.join_chunks(kept, index=b"\x01\x04\x10")


def faulty_streams(valid: bytes) -> dict[str, tuple[bytes, str]]:
    """Damaged or foreign files, made from a valid one, and the error that each must give."""
    flipped = bytearray(valid)
    flipped[len(valid) // 2] ^= 1
    header = ChunkType.SEQUENCE_HEADER
    return {
        "empty": (b"", "TruncatedBitstream"),
        "magic_only": (valid[:8], "TruncatedBitstream"),
        "half": (valid[: len(valid) // 2], "TruncatedBitstream"),
        "no_end_chunk": (valid[:-15], "TruncatedBitstream"),
        "one_bit": (bytes(flipped), "CorruptBitstream"),
        "text_mode": (valid.replace(b"\r\n", b"\n", 1), "NotADgsFile"),
        "foreign_glps": (b"glps" + valid[4:], "NotADgsFile"),
        "trailing_bytes": (valid + b"more", "CorruptBitstream"),
        "version_2": (_chunks_with(valid, _in_chunk(header, 0, 2)), "UnsupportedBitstream"),
        "unknown_profile": (_chunks_with(valid, _in_chunk(header, 1, 9)), "UnsupportedBitstream"),
        "paper_profile": (_chunks_with(valid, _in_chunk(header, 1, 1)), "UnsupportedBitstream"),
        "unknown_level": (_chunks_with(valid, _in_chunk(header, 2, 200)), "UnsupportedBitstream"),
        "sh_degree_4": (_chunks_with(valid, _in_chunk(header, 3, 4)), "LimitExceeded"),
        "unknown_critical_chunk": (_with_chunk(valid, 0x33), "UnsupportedBitstream"),
        "motion_chunk": (_with_chunk(valid, ChunkType.MOTION), "UnsupportedBitstream"),
        "wrong_hash": (_chunks_with(valid, _in_chunk(ChunkType.INTRA_FRAME, 0, 0xAA)), "VerificationError"),
        "no_intra_frame": (_without_intra(valid), "CorruptBitstream"),
    }


def _expectation(path: Path) -> dict[str, list[str]]:
    """Hash of each frame's state, and SHA-256 of its PLY."""
    hashes, digests = [], []
    with tempfile.TemporaryDirectory() as folder:
        for frame in decode_sequence(path):
            ply = Path(folder) / "frame.ply"
            write_ply(ply, frame.cloud())
            hashes.append(frame.state.hash().hex())
            digests.append(hashlib.sha256(ply.read_bytes()).hexdigest())
    return {"frame_hashes": hashes, "ply_sha256": digests}


def make() -> None:
    """Write all streams and what is expected of them."""
    expected: dict[str, object] = {"bitstream_version": BITSTREAM_VERSION}
    for name in ("valid", "faulty"):
        (FOLDER / name).mkdir(parents=True, exist_ok=True)
    valid = {}
    for name, (frames, options) in valid_sequences().items():
        path = FOLDER / "valid" / f"{name}.dgs"
        encode_sequence(frames, path, options, force=True)
        valid[name] = _expectation(path)
    skipping = FOLDER / "valid" / "ancillary_chunk.dgs"
    plain = (FOLDER / "valid" / "skipped_frames_sh0.dgs").read_bytes()
    skipping.write_bytes(_with_chunk(plain, 0xB3))
    valid["ancillary_chunk"] = _expectation(skipping)
    faulty = {}
    for name, (data, error) in faulty_streams(plain).items():
        (FOLDER / "faulty" / f"{name}.dgs").write_bytes(data)
        faulty[name] = error
    expected |= {"valid": valid, "faulty": faulty}
    (FOLDER / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--new-version", action="store_true", help="replace the streams that exist")
    arguments = parser.parse_args()
    if any(FOLDER.glob("*/*.dgs")) and not arguments.new_version:
        print(f"{FOLDER} holds streams; they are frozen. --new-version replaces them", file=sys.stderr)
        return 1
    make()
    return 0


if __name__ == "__main__":
    sys.exit(main())
