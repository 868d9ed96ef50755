"""`dfcgs export`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

import click

from dfcgs_codec.cli.pages import UP, VIEWS, start_view
from dfcgs_codec.cli.refusal import StreamFile, refused_by_name
from dfcgs_codec.cli.values import output_file
from dfcgs_codec.codec.frame.probe import probe
from dfcgs_codec.errors import InputError
from dfcgs_codec.files import replace_when_whole
from dfcgs_codec.player.page import Shown, page

_EPILOG = """
\b
Examples:
  dfcgs export out.dgs page.html
  dfcgs export out.dgs site/index.html --link
"""
#: bytes; browsers hold no text of more than half a gigabyte
_MOST_EMBEDDED = 350 << 20


def _linked(file: Path, output: Path) -> Shown:
    """The file beside the page, as a path from there."""
    try:
        relative = os.path.relpath(file.resolve(), output.resolve().parent)
    except ValueError:
        raise InputError(f"{file} and {output} are on different drives: no link leads there") from None
    return Shown(file.name, url=quote(Path(relative).as_posix()))


def _embedded(file: Path) -> Shown:
    size = file.stat().st_size
    if size > _MOST_EMBEDDED:
        raise InputError(
            f"{file} has {size >> 20} MiB, a page holds {_MOST_EMBEDDED >> 20} MiB at most; --link leaves "
            "the file beside the page"
        )
    return Shown(file.name, path=file)


@click.command(epilog=_EPILOG)
@click.argument("file", type=StreamFile())
@click.argument("output", type=click.Path(), callback=output_file)
@click.option("--link", is_flag=True, help="Leave FILE where it is; a web server then sends both.")
@UP
@VIEWS
@click.option("--force", is_flag=True, help="Replace an existing page.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
def export(file: Path, output: Path, **values: Any) -> None:
    """Make OUTPUT, one web page that plays FILE (.dgs) and needs nothing else, not even a server."""
    with refused_by_name(file):
        probe(file)
    shown = _linked(file, output) if values["link"] else _embedded(file)
    pieces = page([shown], values["up"], start_view(values["views"], file))
    with replace_when_whole(output, force=values["force"]) as target:
        for piece in pieces:
            target.write(piece.encode())
    if not values["quiet"]:
        click.echo(f"{output}: {output.stat().st_size} bytes")
