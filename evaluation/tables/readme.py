"""The results in README.md."""

from __future__ import annotations

from evaluation.tables.comparison import averages
from evaluation.tables.markdown import replace_between
from lab.record import REPOSITORY, results

PAGE = REPOSITORY / "README.md"
_SEQUENCES = {
    "tracked_splat": "trained splat, 125 k, SH 2, 3DGStream-like changes",
    "animated_character": "animated character, 50 k, SH 1",
    "all_attributes_change": "trained splat, 31 k, SH 2, every attribute drifts",
}
_FRAMES = {
    "tracked": "P, 3DGStream-like",
    "all_attributes_drift": "P, every attribute drifts",
    "all_attributes_noise": "P, noise on every value",
    "static": "P, nothing changes",
}


def _bench() -> str:
    return f"""**Against everything that could be installed**: bytes of `dfcgs encode` without options at equal PSNR of rendered images, \
mean over the scenes that a method can code (`bench.json`; negative: ours are fewer). Whole files, swept settings.

{averages()}"""


def _zstd() -> str:
    text = """**Against "quantised delta + zstd"** (same grids and steps, Morton order, temporal difference, byte planes, zstd level 19,
GoF of 10, no dead zone, 20 frames; `against_zstd.json`): bytes as a part of the baseline's. In brackets: the same with our
own three-component turns given to the baseline instead of its four quaternion components, so that only entropy coding differs.

| sequence | P-frames | whole file |
|---|---|---|
"""
    for key, result in results("against_zstd").items():
        plain, strict = result["zstd_quaternion"], result["zstd_turn"]
        text += (
            f"| {_SEQUENCES[key]} | {plain['p_ratio']:.2f} ({strict['p_ratio']:.2f}) "
            f"| {plain['file_ratio']:.2f} ({strict['file_ratio']:.2f}) |\n"
        )
    return text


def _spz() -> str:
    text = """**I-frames against SPZ version 4** at no larger RMS and 99.9th percentile error of any attribute (`against_spz.json`):

| splat | SPZ bytes | ours | ratio |
|---|---|---|---|
"""
    for key, result in results("against_spz").items():
        label = f"{key[:-4]} ({result['num_gaussians'] // 1000} k, SH {result['sh_degree']})"
        text += f"| {label} | {result['spz_bytes']} | {result['codec_bytes']} | {result['ratio']:.3f} |\n"
    return text


def _speed() -> str:
    found = results("speed")
    first = found["tracked"]
    text = f"""**Speed**, {first["num_gaussians"] // 1000} k Gaussians, SH {first["sh_degree"]}, QP 28, one process, seconds, \
median (`speed.json`); decoding is to arrays with the hash checked:

| frame | bytes | encode | decode |
|---|---|---|---|
| I | {first["bytes_i"]} | {first["encode_i_s"]:.2f} | {first["decode_i_s"]:.2f} |
"""
    for key, label in _FRAMES.items():
        r = found[key]
        text += f"| {label} | {r['bytes_p_median']:.0f} | {r['encode_p_s']:.2f} | {r['decode_p_s']:.3f} |\n"
    c = found["character_200k"]
    return (
        text
        + f"""
A walking character of 200 k Gaussians, SH 3: a P-frame encodes in {c["encode_p_s"]:.2f} s and decodes in {c["decode_p_s"]:.2f} s; \
control points take {c["encode_setup_s"]:.2f} s more, and {c["decode_setup_s"]:.2f} s at decoding, once a GoF. (The paper: 0.61 and 0.72 s \
on a GPU.)
"""
    )


def _memory() -> str:
    found = results("memory")
    return f"""**Memory**: 300 frames of 200 k Gaussians (SH 2) encode with two processes in {found["encode"]["peak_mib"]:.0f} MiB, \
all processes together, and decode in {found["decode"]["peak_mib"]:.0f} MiB (`memory.json`).
"""


def filled(text: str) -> str:
    """The page with the results of today; ValueError where they have no place."""
    return replace_between(text, "results", "\n".join((_bench(), _zstd(), _spz(), _speed(), _memory())))
