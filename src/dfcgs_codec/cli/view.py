"""`dfcgs view`."""

from __future__ import annotations

import errno
import tempfile
import webbrowser
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from dfcgs_codec.api import encode_sequence
from dfcgs_codec.cli.pages import UP, VIEWS, start_view
from dfcgs_codec.cli.progress import progress_bar
from dfcgs_codec.cli.refusal import refused_by_name
from dfcgs_codec.codec.frame.probe import probe
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.errors import InputError
from dfcgs_codec.player.page import Shown, page
from dfcgs_codec.player.server import HOST, PlayerServer
from dfcgs_codec.ply import InputPolicy
from dfcgs_codec.sequence import open_frames

_EPILOG = """
\b
Examples:
  dfcgs view out.dgs
  dfcgs view frames/ out.dgs
  dfcgs view out.dgs --up +y --no-browser --port 8000
"""
_MOST_INPUTS = 2


def _encoded(folder: Path, target: Path, quiet: bool) -> Path:
    """The frames of a folder as they are, in a file that the player reads."""
    source = open_frames([str(folder)], policy=InputPolicy(drop_extra=True, repair=True, keep_bits=True))
    with progress_bar(f"reading {folder.name}", quiet) as progress:
        encode_sequence(source, target, EncoderOptions(quality="lossless"), progress=progress)
    return target


def _file(path: Path, target: Path, quiet: bool) -> Path:
    if path.is_dir():
        return _encoded(path, target, quiet)
    with refused_by_name(path):
        probe(path)
    return path


def _server(html: bytes, files: dict[str, Path], port: int) -> PlayerServer:
    try:
        return PlayerServer(html, files, port)
    except OSError as error:
        if error.errno not in (errno.EADDRINUSE, errno.EACCES):
            raise
        raise InputError(f"port {port} of {HOST} cannot be had: {error.strerror}; leave --port out") from None


def _serve(server: PlayerServer, *, opens_browser: bool, quiet: bool) -> None:
    click.echo(server.url)
    if not quiet:
        click.echo("Ctrl-C ends it", err=True)
    if opens_browser and not webbrowser.open(server.url):
        click.echo("note: no browser was found; open the address yourself", err=True)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        if not quiet:
            click.echo("", err=True)
    finally:
        server.server_close()


@click.command(epilog=_EPILOG)
@click.argument(
    "inputs", nargs=-1, metavar="INPUT [OTHER]", type=click.Path(path_type=Path, exists=True), required=True
)
@click.option("--no-browser", is_flag=True, help="Print the address and open nothing.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default="a free one",
    help="The port to serve on.",
)
@UP
@VIEWS
@click.option("--quiet", "-q", is_flag=True, help="Print the address and errors only.")
def view(inputs: tuple[Path, ...], **values: Any) -> None:
    """Show INPUT, a .dgs file or the PLY frames of a folder, in the browser; with OTHER, side by side."""
    if len(inputs) > _MOST_INPUTS:
        raise click.UsageError(f"{len(inputs)} inputs were named; one is shown, or two side by side")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="dfcgs-view-")))
        names = [f"{i}.dgs" for i in range(len(inputs))]
        paths = [
            _file(path, folder / name, values["quiet"]) for path, name in zip(inputs, names, strict=True)
        ]
        shown = [Shown(path.resolve().name, url=name) for path, name in zip(inputs, names, strict=True)]
        html = "".join(page(shown, values["up"], start_view(values["views"], paths[0])))
        server = _server(html.encode(), dict(zip(names, paths, strict=True)), values["port"])
        _serve(server, opens_browser=not values["no_browser"], quiet=values["quiet"])
