"""Write the conformance streams: `make golden`.

Valid and uncommon streams with the hash and the PLY bytes of every frame, faulty ones with the error that
refuses them, and traces of some. tests/conformance/README.md says what they are for.
Released streams are frozen: only those that are missing are added. --new-version writes all of them anew and
belongs to a new version of the bitstream.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from io import BytesIO
from pathlib import Path

import numpy as np

from dfcgs_codec import Bound, EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import (
    BITSTREAM_VERSION,
    LEVELS,
    MAX_COARSE_LOG2,
    MAX_ORIGIN,
    MAX_THIN_OCTAVES,
    STATE_LIMIT,
    Attribute,
    ChunkType,
    IntraKind,
    OutputOrder,
    Profile,
    Tool,
)
from dfcgs_codec.bitstream.frame_headers import InterHeader, IntraHeader, read_lengths
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model, installed
from dfcgs_codec.ply import write_ply

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from lab import small_room as rooms  # noqa: E402
from lab.chunks import Chunk, join_chunks, split_chunks  # noqa: E402
from lab.legal_streams import random_file  # noqa: E402
from lab.options import encoder_options  # noqa: E402
from lab.small_clouds import (  # noqa: E402
    FIELDS,
    all_changing,
    clustered_cloud,
    coincident_cloud,
    drifting,
    make_cloud,
    on_lattices,
    real_cloud,
    shuffled,
    still,
    succeeding,
    swaying,
    travelling,
    waving,
    with_outliers,
)
from tools import traces  # noqa: E402

FOLDER = ROOT / "tests" / "conformance"
#: seeds of `lab.legal_streams` whose files combine what encoders hardly ever do, and are small
UNCOMMON = (7, 11, 14, 24, 31, 38, 44, 49, 60, 62, 63, 65, 66, 74, 86, 92, 94, 97, 102, 106)
#: valid streams with a trace: each part of the format, few bytes
TRACED = (
    "single_gaussian",
    "skipped_frames_sh0",
    "every_gof_a_frame",
    "tracked_sh2",
    "two_quantisers_but_for_scales",
    "cover_classes",
    "motion",
    "births_and_deaths",
    "input_order_topology",
    "escapes_of_still_ones",
    "verbatim_sh1",
    "paper_refined",
)
PAPER = EncoderOptions(profile=Profile.PAPER)
MAIN = encoder_options()
Sequence = tuple[list[GaussianCloud], EncoderOptions]


def _flipping_signs() -> list[GaussianCloud]:
    cloud = real_cloud(60)
    return [replace(cloud, rotations=cloud.rotations * np.float32((-1) ** i)) for i in range(3)]


def _scattered(count: int) -> GaussianCloud:
    """Small Gaussians so far apart that a sort key cannot hold their positions."""
    cloud = make_cloud(count)
    return replace(cloud, positions=cloud.positions * np.float32(1e4), scales=cloud.scales - 2)


def _minute(count: int, sh_degree: int = 0) -> GaussianCloud:
    """Gaussians so small that motion is worth its bytes."""
    cloud = make_cloud(count, sh_degree, 3)
    return replace(cloud, scales=cloud.scales - 3)


def _waving(count: int, num_frames: int) -> list[GaussianCloud]:
    """One half turns about the vertical axis, farther with every frame; the other stands still."""
    cloud = _minute(count)
    return [waving(cloud, 0.1 * index) for index in range(num_frames)]


def _with_far_ones(frames: list[GaussianCloud], where: dict[int, float]) -> list[GaussianCloud]:
    """Gaussian 5 as far away, and Gaussian 6 as coloured, as `where` says of some frames."""
    result = list(frames)
    for index, far in where.items():
        positions, colours = frames[index].positions.copy(), frames[index].sh_dc.copy()
        positions[5], colours[6, 1] = [far, -2 * far, 0], far
        result[index] = replace(frames[index], positions=positions, sh_dc=colours)
    return result


def _on_a_map(cloud: GaussianCloud) -> GaussianCloud:
    """In map coordinates, as doubles."""
    return replace(cloud, positions=cloud.positions.astype(np.float64) + np.array([5e5, 4.6e6, -120.0]))


def _not_finite(cloud: GaussianCloud) -> GaussianCloud:
    """With values that are no numbers, and a quaternion that is none."""
    arrays = {name: getattr(cloud, name).copy() for name in FIELDS}
    arrays["positions"][1] = [np.nan, np.inf, 1]
    arrays["scales"][2], arrays["opacities"][3], arrays["rotations"][4] = -np.inf, np.inf, 0
    arrays["sh_rest"].view("u4")[5] = 0x7F800123
    return GaussianCloud(**arrays)


def valid_sequences() -> dict[str, Sequence]:
    """What the valid streams are made of; each shows one part of the format."""
    real = real_cloud(120)
    return {
        "tracked_sh2": (drifting(real, 4), EncoderOptions(gof_size=3)),
        "all_attributes_sh3": (all_changing(make_cloud(60, 3), 3), EncoderOptions()),
        "skipped_frames_sh0": (still(make_cloud(50), 4), EncoderOptions()),
        "input_order_sh1": (
            drifting(make_cloud(70, 1), 3),
            EncoderOptions(order=OutputOrder.INPUT, gof_size=2),
        ),
        "single_gaussian": (drifting(make_cloud(1), 3), EncoderOptions()),
        "coincident": (travelling(coincident_cloud(80), 2), EncoderOptions()),
        "far_outliers": (
            [with_outliers(make_cloud(90), 4, 1e6)],
            EncoderOptions(qp=4, order=OutputOrder.FREE),
        ),
        "changed_count": ([make_cloud(40), make_cloud(30, 0, 9)], EncoderOptions()),
        "verbatim_sh1": (
            drifting(make_cloud(50, 1), 3),
            encoder_options(intra=IntraKind.PLY, order=OutputOrder.INPUT),
        ),
        "sign_flips": (_flipping_signs(), EncoderOptions()),
        "lost_order": (
            [make_cloud(80), shuffled(make_cloud(80))],
            EncoderOptions(gof_size=1, order=OutputOrder.INPUT),
        ),
        "raw_position_bits": ([_scattered(100)], EncoderOptions(qp=0, order=OutputOrder.FREE)),
        "bounded_turns": (
            all_changing(real_cloud(700), 2),
            EncoderOptions(bounds=(Bound("rotation", 0.5),), order=OutputOrder.INPUT),
        ),
        "values_already_quantised": (
            drifting(on_lattices(real_cloud(800)), 2),
            EncoderOptions(qp=24),
        ),
        "every_gof_a_frame": (drifting(make_cloud(60), 4), EncoderOptions(gof_size=1)),
        "long_gof": (all_changing(make_cloud(70), 12), EncoderOptions(gof_size=12)),
        "bounded": (
            all_changing(clustered_cloud(90, 1), 3),
            EncoderOptions(bounds=(Bound("position", 0.001), Bound("alpha", 0.01))),
        ),
        "uniform_steps": (
            all_changing(make_cloud(70, 1), 3),
            encoder_options(visibility=False),
        ),
        "two_quantisers_sh2": (drifting(real_cloud(1500), 2), EncoderOptions()),
        "two_quantisers_but_for_scales": (
            all_changing(clustered_cloud(1100, 1), 2),
            EncoderOptions(bounds=(Bound("scale", 0.01),), qp=34),
        ),
        "no_cover": (all_changing(real_cloud(200), 3), EncoderOptions()),
        "cover_classes": (
            all_changing(rooms.room(), 2),
            EncoderOptions(qp=36, views=rooms.viewers(), keep_unseen=True),
        ),
        "names_over_gof_borders": (_waving(400, 5), encoder_options(gof_size=2, control_spacing=20)),
        "motion": (_waving(900, 4), encoder_options(control_spacing=20)),
        "motion_after_verbatim": (_waving(300, 3), encoder_options(intra=IntraKind.PLY, control_spacing=10)),
        "motion_only": (_waving(300, 4), encoder_options(motion=MotionMode.ONLY, control_spacing=12)),
        "births_and_deaths": (succeeding(_minute(600), 4), encoder_options(control_spacing=20)),
        "lost_order_topology": (
            succeeding(_minute(400, 1), 4, shuffle=True),
            encoder_options(control_spacing=20),
        ),
        "input_order_topology": (
            succeeding(_minute(300), 3, shuffle=True),
            encoder_options(order=OutputOrder.INPUT, control_spacing=20),
        ),
        "topology_after_verbatim": (
            succeeding(_minute(200), 3),
            encoder_options(intra=IntraKind.PLY, control_spacing=9),
        ),
        "paper": (swaying(real_cloud(900), 4), PAPER),
        "paper_coarse_sh3": (
            swaying(make_cloud(400, 3), 3, 0.8),
            encoder_options(PAPER, latent_step=2, control_spacing=60, num_neighbours=24),
        ),
        "paper_fine": (
            swaying(make_cloud(500), 7, 0.3),
            encoder_options(PAPER, latent_step=0.25, control_spacing=60, gof_size=5),
        ),
        "paper_refined": (
            swaying(real_cloud(400), 3),
            encoder_options(PAPER, refinement=RefinementMode.ON, qp=20),
        ),
        "paper_refined_after_verbatim": (
            all_changing(make_cloud(60, 1), 3),
            encoder_options(PAPER, refinement=RefinementMode.ON, intra=IntraKind.PLY),
        ),
        "prior_tracked_sh2": (drifting(real_cloud(500), 4), replace(MAIN, gof_size=3)),
        "prior_all_attributes_sh3": (all_changing(make_cloud(80, 3), 4), MAIN),
        "prior_many_levels": (drifting(make_cloud(2100), 2), replace(MAIN, qp=24)),
        "prior_few_gaussians": (all_changing(make_cloud(7), 3), MAIN),
        "prior_uniform_steps": (
            all_changing(make_cloud(70, 1), 3),
            encoder_options(MAIN, visibility=False),
        ),
        "prior_motion": (_waving(900, 5), encoder_options(MAIN, control_spacing=20)),
        "prior_births_and_deaths": (
            succeeding(_minute(600), 5),
            encoder_options(MAIN, control_spacing=20),
        ),
        "escapes": (
            _with_far_ones(drifting(make_cloud(80), 6), {0: 1e12, 2: 1e9, 3: 1e9, 5: 1e30}),
            EncoderOptions(gof_size=4),
        ),
        "escapes_of_still_ones": (
            _with_far_ones(still(make_cloud(40), 4), {1: 1e12, 2: 1e12}),
            EncoderOptions(),
        ),
        "escapes_and_topology": (
            _with_far_ones(succeeding(_minute(200), 3, shuffle=True), {1: 1e10, 2: 1e10}),
            encoder_options(order=OutputOrder.INPUT, control_spacing=20),
        ),
        "escapes_paper": (_with_far_ones(swaying(real_cloud(300), 3), {1: 1e12}), PAPER),
        "float64_from_origin": (
            _with_far_ones([_on_a_map(c) for c in drifting(make_cloud(90), 3)], {1: 1e15}),
            EncoderOptions(qp=18),
        ),
        "empty_frames": (
            [make_cloud(n, 1) for n in (0, 0, 30, 0, 20)],
            EncoderOptions(order=OutputOrder.INPUT),
        ),
        "verbatim_not_finite": (
            [_not_finite(cloud) for cloud in drifting(make_cloud(40, 1), 3)],
            encoder_options(intra=IntraKind.PLY, order=OutputOrder.INPUT),
        ),
        "odd_rate": (
            still(make_cloud(5), 2),
            EncoderOptions(frame_rate=Fraction(30000, 1001)),
        ),
    }


def _with_gaps(data: bytes) -> bytes:
    """Frame numbers 3, 4, 9 and 20 in place of 0 to 3."""
    chunks = split_chunks(data)
    header = SequenceHeader.read(ByteReader(chunks[0].payload))
    writer = ByteWriter()
    replace(header, frame_numbers=FrameNumbers.of([3, 4, 9, 20])).write(writer)
    return join_chunks([replace(chunks[0], payload=writer.getvalue()), *chunks[1:]])


def _chunks_with(data: bytes, change: Callable[[Chunk], Chunk]) -> bytes:
    """The file with every chunk changed, checksums and index right again."""
    return join_chunks([change(chunk) for chunk in split_chunks(data)])


def _in_chunk(chunk_type: ChunkType, position: int, value: int) -> Callable[[Chunk], Chunk]:
    """Replace one payload byte of every chunk of a type."""

    def change(chunk: Chunk) -> Chunk:
        if chunk.chunk_type != chunk_type:
            return chunk
        payload = bytearray(chunk.payload)
        payload[position] = value
        return replace(chunk, payload=bytes(payload))

    return change


def _with_chunk(data: bytes, chunk_type: int) -> bytes:
    chunks = split_chunks(data)
    return join_chunks([chunks[0], Chunk(chunk_type, 0, b"of another time"), *chunks[1:]])


def _without_intra(data: bytes) -> bytes:
    kept = [c for c in split_chunks(data) if c.chunk_type != ChunkType.INTRA_FRAME]
    return join_chunks(kept, index=b"\x01\x04\x10")


def _changed_intra(data: bytes, change: Callable[[IntraHeader], IntraHeader], more: bytes = b"") -> bytes:
    """The file with the headers of its I-frames changed, and bytes appended to their payloads."""
    sequence = SequenceHeader.read(ByteReader(split_chunks(data)[0].payload))

    def rewrite(chunk: Chunk) -> Chunk:
        if chunk.chunk_type != ChunkType.INTRA_FRAME:
            return chunk
        reader = ByteReader(chunk.payload)
        header = IntraHeader.read(reader, sequence)
        writer = ByteWriter()
        change(header).write(writer)
        return replace(chunk, payload=writer.getvalue() + reader.raw(reader.remaining) + more)

    return _chunks_with(data, rewrite)


def _with_rotation_step(data: bytes, step: int) -> bytes:
    """The file with another step of rotation symbols in its P-frames."""
    sequence = SequenceHeader.read(ByteReader(split_chunks(data)[0].payload))

    def rewrite(chunk: Chunk) -> Chunk:
        if chunk.chunk_type != ChunkType.INTER_FRAME:
            return chunk
        header = InterHeader.read(ByteReader(chunk.payload), sequence)
        writer = ByteWriter()
        replace(header, steps=header.steps | {Attribute.ROTATION: step}).write(writer)
        return replace(chunk, payload=writer.getvalue())

    return _chunks_with(data, rewrite)


def _refined_alone(data: bytes) -> bytes:
    """The file with REFINEMENT in each P-frame, which refines nothing where SH has degree 0."""
    frames = {frame.index: frame.state for frame in SequenceDecoder(BytesIO(data)).frames()}

    def rewrite(chunk: Chunk) -> Chunk:
        if chunk.chunk_type != ChunkType.INTER_FRAME:
            return chunk
        frame_hash = replace(frames[chunk.frame_index], verbatim=None).hash()
        writer = ByteWriter()
        InterHeader(frame_hash, frozenset({Tool.REFINEMENT}), {}).write(writer)
        return replace(chunk, payload=writer.getvalue())

    return _chunks_with(data, rewrite)


def _encoded(frames: list[GaussianCloud], options: EncoderOptions) -> bytes:
    """A stream that others are made from, itself not kept."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stream.dgs"
        encode_sequence(frames, path, options)
        return path.read_bytes()


def _still_after_verbatim() -> bytes:
    """Profile PAPER, SH degree 0: a verbatim I-frame that is repeated."""
    return _encoded(still(make_cloud(50), 3), encoder_options(PAPER, intra=IntraKind.PLY))


def _finely_turned() -> bytes:
    """P-frames whose rotation symbols are large."""
    return _encoded(all_changing(make_cloud(40), 2), EncoderOptions(qp=4))


def _with_units(data: bytes, **changes: object) -> bytes:
    chunks = split_chunks(data)
    header = SequenceHeader.read(ByteReader(chunks[0].payload))
    writer = ByteWriter()
    replace(header, unit_exponents=replace(header.unit_exponents, **changes)).write(writer)
    return join_chunks([replace(chunks[0], payload=writer.getvalue()), *chunks[1:]])


def _with_model(data: bytes, model_id: str, model_hash: bytes) -> bytes:
    chunks = split_chunks(data)
    header = SequenceHeader.read(ByteReader(chunks[0].payload))
    writer = ByteWriter()
    replace(header, model_id=model_id, model_hash=model_hash).write(writer)
    return join_chunks([replace(chunks[0], payload=writer.getvalue()), *chunks[1:]])


def _without(data: bytes, chunk_type: int) -> bytes:
    kept = [c for c in split_chunks(data) if c.chunk_type != chunk_type]
    return join_chunks(kept)


def _with_spare_words(data: bytes) -> bytes:
    """The last stream of the I-frame with eight bytes that no symbol needs."""
    sequence = SequenceHeader.read(ByteReader(split_chunks(data)[0].payload))

    def rewrite(chunk: Chunk) -> Chunk:
        if chunk.chunk_type != ChunkType.INTRA_FRAME:
            return chunk
        reader, writer = ByteReader(chunk.payload), ByteWriter()
        header = IntraHeader.read(reader, sequence)
        header.write(writer)
        *lengths, last = read_lengths(reader, header.streams(sequence.sh_degree)).values()
        for length in [*lengths, last + 8]:
            writer.uvarint(length)
        return replace(chunk, payload=writer.getvalue() + reader.raw(reader.remaining) + bytes(8))

    return _chunks_with(data, rewrite)


def _crowded(header: IntraHeader) -> IntraHeader:
    """More control points than level 1 allows."""
    return replace(
        header,
        num_gaussians=LEVELS[1].max_control_points + 1,
        control=replace(header.control, spacing=1),
    )


def _coarse(header: IntraHeader) -> IntraHeader:
    assert header.steps is not None
    return replace(header, steps=replace(header.steps, coarse_log2=MAX_COARSE_LOG2 + 1))


def _thin(header: IntraHeader) -> IntraHeader:
    assert header.steps is not None
    return replace(header, steps=replace(header.steps, thin_octaves=MAX_THIN_OCTAVES + 1))


def _alternating_positions(header: IntraHeader) -> IntraHeader:
    assert header.steps is not None
    return replace(header, steps=replace(header.steps, alternating=frozenset({Attribute.POSITION})))


def _steps(value: int) -> Callable[[IntraHeader], IntraHeader]:
    def change(header: IntraHeader) -> IntraHeader:
        assert header.steps is not None
        return replace(header, steps=replace(header.steps, steps=dict.fromkeys(header.steps.steps, value)))

    return change


def more_faulty_streams(valid: bytes, moving: bytes) -> dict[str, tuple[bytes, str]]:
    """Files with right checksums whose contents cannot be; `moving` has P-frames with residuals."""
    level_limit = LEVELS[1].max_gaussians
    damaged = bytearray(_with_chunk(valid, 0xB3))
    damaged[damaged.index(b"of another time")] ^= 1
    long_integer = b"\x80\x00"
    header = split_chunks(valid)[0]
    stretched = replace(header, payload=header.payload[:5] + long_integer + header.payload[6:])
    return {
        "no_gaussians": (_changed_intra(valid, lambda h: replace(h, num_gaussians=0)), "CorruptBitstream"),
        "too_many_gaussians": (
            _changed_intra(valid, lambda h: replace(h, num_gaussians=level_limit + 1)),
            "LimitExceeded",
        ),
        "too_many_control_points": (_changed_intra(valid, _crowded), "LimitExceeded"),
        "step_0": (_changed_intra(valid, _steps(0)), "CorruptBitstream"),
        "step_too_large": (_changed_intra(valid, _steps(STATE_LIMIT + 1)), "LimitExceeded"),
        "coarse_positions": (_changed_intra(valid, _coarse), "LimitExceeded"),
        "thin_axes": (_changed_intra(valid, _thin), "LimitExceeded"),
        "alternating_positions": (_changed_intra(valid, _alternating_positions), "CorruptBitstream"),
        "rotation_symbol_too_large": (
            _with_rotation_step(_finely_turned(), STATE_LIMIT),
            "CorruptBitstream",
        ),
        "spare_words": (_with_spare_words(valid), "CorruptBitstream"),
        "spare_bytes": (_changed_intra(valid, lambda h: h, bytes(4)), "CorruptBitstream"),
        "coarse_opacity": (_with_units(valid, opacity=-10), "LimitExceeded"),
        "far_origin": (_with_units(valid, origin=(0, MAX_ORIGIN + 1, 0)), "LimitExceeded"),
        "unknown_precision": (_with_units(valid, precision=2), "UnsupportedBitstream"),
        "missing_residual": (_without(moving, ChunkType.RESIDUAL), "CorruptBitstream"),
        "missing_frames": (_without(moving, ChunkType.INTER_FRAME), "CorruptBitstream"),
        "damaged_ancillary_chunk": (bytes(damaged), "CorruptBitstream"),
        "long_integer": (
            join_chunks([stretched, *split_chunks(valid)[1:]]),
            "CorruptBitstream",
        ),
        "unknown_tool": (
            _chunks_with(valid, _in_chunk(ChunkType.INTER_FRAME, 16, 0x80)),
            "UnsupportedBitstream",
        ),
        "unknown_attribute": (
            _chunks_with(valid, _in_chunk(ChunkType.INTER_FRAME, 17, 0x80)),
            "CorruptBitstream",
        ),
    }


def faulty_escapes(valid: bytes) -> dict[str, tuple[bytes, str]]:
    """Escapes that cannot be; in `valid` one chunk of them has three."""
    chunk = next(c for c in split_chunks(valid) if c.chunk_type == ChunkType.ESCAPES)
    payload, corrupt = chunk.payload, "CorruptBitstream"
    count = payload[0]
    columns, patterns = payload[1 + count : 1 + 2 * count], payload[1 + 2 * count :]
    changed = {
        "escapes_out_of_order": payload[: 1 + count] + columns[::-1] + patterns,
        "escape_of_no_gaussian": payload[:1] + b"\x7f" + payload[2:],
        "escape_of_no_attribute": payload[: 2 * count] + b"\x0e" + patterns,
        "escapes_and_more": payload + b"\0",
        "too_many_escapes": b"\x7f" + payload[1:],
    }

    def rewritten(by: bytes) -> bytes:
        return _chunks_with(valid, lambda c: replace(c, payload=by) if c.payload == payload else c)

    errors = {"too_many_escapes": "LimitExceeded"}
    streams = {name: (rewritten(by), errors.get(name, corrupt)) for name, by in changed.items()}
    return streams | {"missing_escapes": (_without(valid, ChunkType.ESCAPES), corrupt)}


def faulty_paper_streams(valid: bytes) -> dict[str, tuple[bytes, str]]:
    """Files of profile PAPER that cannot be; in `valid` frames move by latents and nothing else."""
    chunks = split_chunks(valid)
    tools = 16
    other = replace(chunks[0], payload=chunks[0].payload[:-1] + bytes([chunks[0].payload[-1] ^ 1]))
    return {
        "another_model": (join_chunks([other, *chunks[1:]]), "ModelMismatch"),
        "missing_hyperprior": (_without(valid, ChunkType.HYPERPRIOR), "CorruptBitstream"),
        "missing_latents": (_without(valid, ChunkType.MOTION), "CorruptBitstream"),
        "main_tool_in_paper": (
            _chunks_with(valid, _in_chunk(ChunkType.INTER_FRAME, tools, 1)),
            "CorruptBitstream",
        ),
        "attributes_in_paper": (
            _chunks_with(valid, _in_chunk(ChunkType.INTER_FRAME, tools + 1, 1)),
            "CorruptBitstream",
        ),
        "fewer_latents": (_chunks_with(valid, _in_chunk(ChunkType.MOTION, 0, 3)), "CorruptBitstream"),
        "latent_step_too_large": (_chunks_with(valid, _in_chunk(ChunkType.MOTION, 1, 14)), "LimitExceeded"),
    }


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
        "version_8": (_chunks_with(valid, _in_chunk(header, 0, 8)), "UnsupportedBitstream"),
        "version_200": (_chunks_with(valid, _in_chunk(header, 0, 200)), "UnsupportedBitstream"),
        "unknown_profile": (_chunks_with(valid, _in_chunk(header, 1, 9)), "UnsupportedBitstream"),
        "paper_profile": (_chunks_with(valid, _in_chunk(header, 1, 1)), "ModelMismatch"),
        "unknown_level": (_chunks_with(valid, _in_chunk(header, 2, 200)), "UnsupportedBitstream"),
        "sh_degree_4": (_chunks_with(valid, _in_chunk(header, 3, 4)), "LimitExceeded"),
        "unknown_critical_chunk": (_with_chunk(valid, 0x33), "UnsupportedBitstream"),
        "hyperprior_chunk": (_with_chunk(valid, ChunkType.HYPERPRIOR), "CorruptBitstream"),
        "misplaced_topology": (_with_chunk(valid, ChunkType.TOPOLOGY), "CorruptBitstream"),
        "misplaced_motion": (_with_chunk(valid, ChunkType.MOTION), "CorruptBitstream"),
        "wrong_hash": (_chunks_with(valid, _in_chunk(ChunkType.INTRA_FRAME, 0, 0xAA)), "VerificationError"),
        "another_prior": (_with_model(valid, "main-1", bytes(8)), "ModelMismatch"),
        "model_of_paper": (_with_model(valid, "paper-1", installed("paper-1").digest[:8]), "ModelMismatch"),
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


def _read(name: str) -> bytes:
    return (FOLDER / "valid" / f"{name}.dgs").read_bytes()


def _annexes(path: Path) -> list[str]:
    """Annexes of the specification that a decoder needs beside the baseline."""
    chunks = split_chunks(path.read_bytes())
    kinds = {chunk.payload[16] for chunk in chunks if chunk.chunk_type == ChunkType.INTRA_FRAME}
    is_paper = SequenceHeader.read(ByteReader(chunks[0].payload)).profile == Profile.PAPER
    return ["A"] * (IntraKind.PLY in kinds) + ["B"] * is_paper


def _derived() -> dict[str, bytes]:
    """Valid streams made from others."""
    return {
        "ancillary_chunk": _with_chunk(_read("skipped_frames_sh0"), 0xB3),
        "numbers_with_gaps": _with_gaps(_read("skipped_frames_sh0")),
        "ply_comments": _with_chunk(_read("skipped_frames_sh0"), ChunkType.PLY_COMMENTS),
        "paper_refined_after_verbatim_sh0": _refined_alone(_still_after_verbatim()),
    }


def _make_valid(expected: dict[str, object]) -> None:
    for name, (frames, options) in valid_sequences().items():
        if name not in expected:
            encode_sequence(frames, FOLDER / "valid" / f"{name}.dgs", options, force=True)
    for name, data in _derived().items():
        if name not in expected:
            (FOLDER / "valid" / f"{name}.dgs").write_bytes(data)
    _expect("valid", expected)


def _make_uncommon(expected: dict[str, object]) -> None:
    model = context_model(DEFAULT_PRIOR)
    for seed in UNCOMMON:
        if f"seed_{seed}" not in expected:
            (FOLDER / "uncommon" / f"seed_{seed}.dgs").write_bytes(random_file(seed, model, num_frames=4))
    _expect("uncommon", expected)


def _expect(kind: str, expected: dict[str, object]) -> None:
    """Write down what new streams decode to."""
    for path in sorted((FOLDER / kind).glob("*.dgs")):
        if path.stem not in expected:
            expected[path.stem] = {"annexes": _annexes(path), **_expectation(path)}


def _make_traces(*, new_version: bool) -> int:
    """Write the traces that are missing, or all; returns how many."""
    written = 0
    for name in TRACED:
        path = FOLDER / "traces" / f"{name}.json"
        if new_version or not path.exists():
            path.write_text(traces.as_text(traces.trace(_read(name))))
            written += 1
    return written


def _make_faulty(expected: dict[str, object]) -> None:
    plain, moving = _read("skipped_frames_sh0"), _read("prior_uniform_steps")
    streams = faulty_streams(plain) | more_faulty_streams(plain, moving)
    streams |= faulty_paper_streams(_read("paper")) | faulty_escapes(_read("escapes_of_still_ones"))
    verbatim, empty = _read("verbatim_sh1"), _read("empty_frames")
    streams |= {
        "escapes_in_verbatim": (
            _changed_intra(verbatim, lambda h: replace(h, has_escapes=True)),
            "CorruptBitstream",
        ),
        "change_of_an_empty_frame": (
            _chunks_with(empty, _in_chunk(ChunkType.INTER_FRAME, 16, 0x20)),
            "CorruptBitstream",
        ),
    }
    for name, (data, error) in streams.items():
        if name not in expected:
            (FOLDER / "faulty" / f"{name}.dgs").write_bytes(data)
            expected[name] = error


def make(*, new_version: bool) -> int:
    """Write the streams that are missing, or all, and what is expected of them; returns how many."""
    path = FOLDER / "expected.json"
    expected: dict[str, dict[str, object]] = {"valid": {}, "uncommon": {}, "faulty": {}}
    if path.exists() and not new_version:
        known = json.loads(path.read_text())
        if known["bitstream_version"] != BITSTREAM_VERSION:
            raise SystemExit(f"{path} is of another bitstream version; --new-version replaces all streams")
        expected = {kind: known.get(kind, {}) for kind in expected}
    before = sum(map(len, expected.values()))
    for name in (*expected, "traces"):
        (FOLDER / name).mkdir(parents=True, exist_ok=True)
    _make_valid(expected["valid"])
    _make_uncommon(expected["uncommon"])
    _make_faulty(expected["faulty"])
    path.write_text(json.dumps({"bitstream_version": BITSTREAM_VERSION} | expected, indent=1) + "\n")
    return sum(map(len, expected.values())) - before + _make_traces(new_version=new_version)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--new-version", action="store_true", help="replace the streams that exist")
    written = make(new_version=parser.parse_args().new_version)
    print(f"{written} streams and traces written to {FOLDER}; those that existed are frozen", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
