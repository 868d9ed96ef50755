"""Tables of comparisons at equal errors, and of single frames' seconds."""

from __future__ import annotations

from evaluation.tables.markdown import table
from lab.record import results

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
    "character_200k": "P, walking character, 200 k, SH 3",
}


def zstd_table() -> str:
    """Bytes as a part of those of quantised delta + zstd, at equal steps."""
    rows = []
    for key, result in results("against_zstd").items():
        plain, strict = result["zstd_quaternion"], result["zstd_turn"]
        cells = [f"{plain[part]:.2f} ({strict[part]:.2f})" for part in ("p_ratio", "file_ratio")]
        rows.append([_SEQUENCES[key], *cells])
    return table(["sequence", "P-frames", "whole file"], rows)


def spz_table() -> str:
    """I-frames against SPZ at equal errors of every attribute."""
    rows = [
        [
            f"{key[:-4]} ({result['num_gaussians'] // 1000} k, SH {result['sh_degree']})",
            str(result["spz_bytes"]),
            str(result["codec_bytes"]),
            f"{result['ratio']:.3f}",
        ]
        for key, result in results("against_spz").items()
    ]
    return table(["splat", "SPZ bytes", "ours", "ratio"], rows)


def frame_times_table() -> str:
    """Bytes and seconds of single frames, and what control points take once a GoF."""
    found = results("speed")
    first = found["tracked"]
    rows = [["I", str(first["bytes_i"]), f"{first['encode_i_s']:.2f}", f"{first['decode_i_s']:.2f}"]]
    for key, label in _FRAMES.items():
        r = found[key]
        rows.append([label, f"{r['bytes_p_median']:.0f}", f"{r['encode_p_s']:.2f}", f"{r['decode_p_s']:.3f}"])
    setup = found["character_200k"]
    return (
        table(["frame", "bytes", "encode, s", "decode, s"], rows)
        + f"\nControl points of the walking character take {setup['encode_setup_s']:.2f} s more at encoding "
        f"and {setup['decode_setup_s']:.2f} s more at decoding, once a GoF.\n"
    )


def memory() -> str:
    """Peak memory of a long sequence, a sentence."""
    encode, decode = (results("memory")[direction]["peak_mib"] for direction in ("encode", "decode"))
    return (
        f"300 frames of 200 k Gaussians encode in {encode:.0f} MiB (two processes together) "
        f"and decode in {decode:.0f} MiB.\n"
    )
