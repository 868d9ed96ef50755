"""`dfcgs info`."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import click

from dfcgs_codec.cli.refusal import StreamFile, refused_by_name
from dfcgs_codec.codec.frame.probe import SequenceInfo, probe

_EPILOG = """
\b
Examples:
  dfcgs info out.dgs
  dfcgs info out.dgs --frames
  dfcgs info out.dgs --json | jq .bits_per_gaussian
"""


def _table(title: str, counts: Counter[str], total: int) -> list[str]:
    lines = [f"{title:18} {'bytes':>12} {'share':>7}"]
    for name, count in counts.items():
        lines.append(f"{name.lower():18} {count:12d} {count / total:6.1%}")
    return lines


def _printable(text: str) -> str:
    """`text` from a file, which anybody may have made: what a terminal would obey is spelled out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def _summary(info: SequenceInfo) -> list[str]:
    header = info.header
    counts = [frame.num_gaussians for frame in info.frames]
    gaussians = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"
    rate = header.frame_rate[0] / header.frame_rate[1]
    values = info.as_dict()
    order = header.output_order.name.lower()
    model = f", model {_printable(header.model_id)}" if header.model_id else ""
    rows = {
        "frames": f"{header.num_frames} at {rate:g} per second",
        "Gaussians": f"{gaussians}, SH degree {header.sh_degree}, order {order}",
        "bitstream": f"version {values['bitstream_version']}, profile {values['profile']}{model}",
        "encoder": _printable(info.encoder_info) or "unknown",
        "size": f"{info.num_bytes} bytes, {info.num_bytes / header.num_frames:.0f} per frame",
        "against PLY": f"{values['compression_ratio']:.2f}x smaller",
        "bits per Gaussian": f"{values['bits_per_gaussian']:.2f}",
    }
    return [f"{name:18} {value}" for name, value in rows.items()]


def _frame_lines(info: SequenceInfo) -> list[str]:
    lines = [f"{'frame':>6} {'number':>7} {'type':5} {'gaussians':>10} {'bytes':>10}"]
    for f in info.frames:
        names = f"{f.frame_index:6d} {f.frame_number:7d} {f.frame_type:5}"
        lines.append(f"{names} {f.num_gaussians:10d} {f.num_bytes:10d}")
    return lines


def _chunk_lines(info: SequenceInfo) -> list[str]:
    lines = [f"{'offset':>10} {'bytes':>10} {'frame':>6} chunk"]
    for name, frame_index, offset, size in info.chunks:
        lines.append(f"{offset:10d} {size:10d} {frame_index:6d} {name.lower()}")
    return lines


@click.command(epilog=_EPILOG)
@click.argument("file", type=StreamFile())
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.option("--frames", is_flag=True, help="List the frames.")
@click.option("--chunks", is_flag=True, help="List the chunks.")
def info(file: Path, as_json: bool, frames: bool, chunks: bool) -> None:
    """Say what is in FILE (.dgs); reads headers only."""
    with refused_by_name(file):
        found = probe(file)
    if as_json:
        values = found.as_dict()
        if chunks:
            names = ("chunk_type", "frame_index", "offset", "num_bytes")
            values["chunks"] = [dict(zip(names, chunk, strict=True)) for chunk in found.chunks]
        click.echo(json.dumps(values, indent=2))
        return
    lines = _summary(found)
    for title, key in (("frame type", "frame_type"), ("attribute", "attribute")):
        lines += ["", *_table(title, found.bytes_by(key), found.num_bytes)]
    lines += ["", *_table("chunk", found.chunk_bytes, found.num_bytes)]
    if frames:
        lines += ["", *_frame_lines(found)]
    if chunks:
        lines += ["", *_chunk_lines(found)]
    click.echo("\n".join(lines))
