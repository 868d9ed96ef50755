"""`dfcgs decode`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import click

from dfcgs_codec.cli.progress import progress_bar
from dfcgs_codec.cli.refusal import StreamFile, refused_by_name
from dfcgs_codec.cli.values import frame_range, memory_size, output_folder
from dfcgs_codec.codec.frame.decoder import DecodedFrame, SequenceDecoder
from dfcgs_codec.codec.frame.limits import DecoderLimits
from dfcgs_codec.codec.frame.salvage import salvage
from dfcgs_codec.core.engine import ENGINES, VARIABLE
from dfcgs_codec.errors import CorruptBitstream, InputError
from dfcgs_codec.files import FRAME_NAME, begin_sync, named, replace_folder_when_whole
from dfcgs_codec.ply import write_ply

_EPILOG = """
\b
Examples:
  dfcgs decode out.dgs decoded/
  dfcgs decode out.dgs part/ --frames 100:110
  dfcgs decode out.dgs --check-only
  dfcgs decode damaged.dgs rescued/ --salvage
"""


def _frames(file: BinaryIO, values: dict[str, Any], losses: list[str]) -> tuple[Iterator[DecodedFrame], int]:
    """The frames asked for, and how many there are at most."""
    limits = DecoderLimits(values["max_memory"], values["max_gaussians"])
    if values["salvage"]:
        return salvage(file, losses, limits, values["engine"]), 0
    decoder = SequenceDecoder(file, limits=limits, engine=values["engine"])
    total = decoder.sequence.num_frames
    start, stop = values["frames"] or (0, None)
    if start >= total or (stop or 0) > total:
        raise click.UsageError(f"--frames {start}:{stop or ''}: the file has frames 0 to {total - 1}")
    return decoder.frames(start, stop), (stop or total) - start


def _check_apart(file: Path, output_dir: Path) -> None:
    if output_dir.is_dir() and output_dir.samefile(file.absolute().parent):
        raise InputError(f"{output_dir} holds {file.name} itself: name another folder for the frames")


def _write(frame: DecodedFrame, folder: Path, output_dir: Path) -> None:
    """Into `folder`, which becomes `output_dir`: that is the name to speak of."""
    name = FRAME_NAME.format(frame.number)
    with named(output_dir / name):
        write_ply(folder / name, frame.cloud(), frame.comments)
    begin_sync(folder / name)


def _run(file: BinaryIO, write: Callable[[DecodedFrame], None], values: dict[str, Any]) -> int:
    losses: list[str] = []
    frames, total = _frames(file, values, losses)
    done = 0
    with progress_bar("decoding", values["quiet"]) as progress:
        for frame in frames:
            write(frame)
            done += 1
            progress(done, max(total, done))
    for loss in losses:
        click.echo(f"lost: {loss}", err=True)
    if not done:
        raise CorruptBitstream("no frame is whole: nothing could be salvaged")
    return done


@click.command(epilog=_EPILOG)
@click.argument("file", type=StreamFile())
@click.argument("output_dir", type=click.Path(), required=False, callback=output_folder)
@click.option(
    "--frames", type=frame_range, metavar="A:B", help="Only frames A to B - 1, counted from 0; seeks."
)
@click.option("--check-only", is_flag=True, help="Decode and check every hash, write nothing.")
@click.option(
    "--salvage", is_flag=True, help="Write all frames that a damaged or truncated file still holds."
)
@click.option(
    "--max-memory",
    type=memory_size,
    metavar="SIZE",
    default="2G",
    show_default=True,
    help="Refuse frames that need more, before it is taken.",
)
@click.option(
    "--max-gaussians",
    type=click.IntRange(min=1),
    help="Take frames of so many Gaussians however few bytes they have, none larger. "
    "[default: memory and time grow with the bytes read]",
)
@click.option(
    "--engine",
    type=click.Choice(ENGINES),
    help="What decodes: the C core, or numpy, which is the reference and slower; the frames are the same. "
    f"[default: {VARIABLE} of the environment, or the core where wasmtime can be imported]",
)
@click.option("--force", is_flag=True, help="Replace an existing folder of frames.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors and losses.")
def decode(file: Path, output_dir: Path | None, **values: Any) -> None:
    """Decode FILE (.dgs) into OUTPUT_DIR, one frame_NNNN.ply per frame, numbered as the input was."""
    if (output_dir is None) != values["check_only"]:
        raise click.UsageError("name an OUTPUT_DIR, or --check-only without one")
    if values["salvage"] and values["frames"]:
        raise click.UsageError("--salvage takes all frames it can get; --frames does not go with it")
    with refused_by_name(file, salvage=not values["salvage"]), file.open("rb") as stream:
        if output_dir is None:
            done = _run(stream, lambda frame: None, values)
        else:
            _check_apart(file, output_dir)
            with replace_folder_when_whole(output_dir, force=values["force"]) as folder:
                done = _run(stream, lambda frame: _write(frame, folder, output_dir), values)
    if not values["quiet"]:
        click.echo(f"{done} frames, all hashes right" + (f": {output_dir}" if output_dir else ""))
