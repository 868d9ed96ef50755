"""The page of the player: HTML with its script, the core and the models in it, and perhaps the file."""

from __future__ import annotations

import html
import json
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import BinaryIO

from dfcgs_codec.player.assets import assets_json
from dfcgs_codec.views.camera import ViewCamera

SCRIPT = Path(__file__).with_name("player.js")
UP_AXES = ("-y", "+y", "+z", "-z", "+x", "-x")
#: nothing but the page itself and what lies beside it is loaded
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; worker-src blob:; "
    "style-src 'unsafe-inline'; connect-src 'self'; img-src data:"
)
_STYLE = (
    "html,body{margin:0;height:100%;background:#000}body{display:flex;flex-wrap:wrap;gap:2px}"
    "figure{flex:1 1 320px;margin:0;min-height:50%;position:relative;display:flex}"
    "dfcgs-player{flex:1}figcaption{position:absolute;top:8px;right:8px;padding:4px 10px;border-radius:6px;"
    "background:#000a;color:#eee;font:14px system-ui,sans-serif}figcaption[hidden]{display:none}"
    "noscript{color:#eee;font:16px system-ui,sans-serif;padding:2em}"
)
#: bytes that are encoded at once; three become four characters
_BLOCK = 3 << 18


@dataclass(frozen=True)
class Shown:
    """A file on the page: the name that people read, and an address beside the page or a file to embed."""

    name: str
    url: str | None = None
    path: Path | None = None


@dataclass(frozen=True)
class StartView:
    """Where the camera stands at first, and what it looks at, in scene units."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    @staticmethod
    def of(camera: ViewCamera, distance: float) -> StartView:
        """As a camera of the scene sees it; it turns around what is `distance` before it."""
        eye, target = camera.position, camera.position + distance * camera.forward
        return StartView(tuple(eye.tolist()), tuple(target.tolist()))


@cache
def _script() -> str:
    return SCRIPT.read_text()


def _data_json(value: object) -> str:
    """JSON that ends no element of HTML, whatever names are in it."""
    return json.dumps(value).replace("<", "\\u003c")


def _config(files: Sequence[Shown], up: str, view: StartView | None) -> dict[str, object]:
    named = [
        {"name": one.name, "url": one.url} if one.path is None else {"name": one.name, "data": f"file{i}"}
        for i, one in enumerate(files)
    ]
    config: dict[str, object] = {"files": named, "up": up}
    return config if view is None else config | {"view": {"eye": view.eye, "target": view.target}}


def _embedded(file: BinaryIO, name: str) -> Iterator[str]:
    yield f'<script type="text/plain" id="{name}">'
    while block := file.read(_BLOCK):
        yield b64encode(block).decode("ascii")
    yield "</script>\n"


def page(files: Sequence[Shown], up: str = "-y", view: StartView | None = None) -> Iterator[str]:
    """The page, in pieces: shows one file, or two side by side."""
    title = html.escape(" | ".join(one.name for one in files))
    yield (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        f"<style>{_STYLE}</style></head><body>\n"
        "<noscript>This page decodes and draws its scene with JavaScript, which is switched off.</noscript>\n"
    )
    yield f'<script type="application/json" id="config">{_data_json(_config(files, up, view))}</script>\n'
    yield f'<script type="application/json" id="assets">{assets_json()}</script>\n'
    for i, one in enumerate(files):
        if one.path is not None:
            with one.path.open("rb") as file:
                yield from _embedded(file, f"file{i}")
    yield f"<script>{_script()}</script>\n</body></html>\n"
