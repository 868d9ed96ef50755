"""The npm package, where `make player-package` has built it, in a real browser."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec import decode_sequence
from tests.helpers import ROOT

MODULE = ROOT / "player" / "dist" / "index.js"
VALID = ROOT / "tests" / "conformance" / "valid"
_PAGE = b"""<!doctype html><script type="module">
import { decode } from "./index.js";
const hex = (bytes) => [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
window.digests = async (url) => {
  const found = [];
  for await (const { positions, rotations, scales, opacities, shDc, shRest } of decode(url)) {
    const blob = new Blob([positions, rotations, scales, opacities, shDc, shRest]);
    found.push(hex(await crypto.subtle.digest("SHA-256", await blob.arrayBuffer())));
  }
  return found;
};
document.title = "ready";
</script>"""


@pytest.fixture(scope="module")
def site(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The package, all conformance streams and the demo on a plain server, which knows no ranges."""
    if not MODULE.exists():
        pytest.skip("the npm package is not built: make player-package")
    folder = tmp_path_factory.mktemp("site")
    for path in [MODULE, demo, *VALID.glob("*.dgs")]:
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "index.html").write_bytes(_PAGE)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=folder))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    thread.join()
    server.server_close()


def digests(path: Path) -> list[str]:
    """Of the arrays of each frame, as Python decodes them."""
    found = []
    for frame in decode_sequence(path):
        cloud, digest = frame.cloud(), hashlib.sha256()
        for name in ("positions", "rotations", "scales", "opacities", "sh_dc", "sh_rest"):
            digest.update(getattr(cloud, name).tobytes())
        found.append(digest.hexdigest())
    return found


def test_every_frame_is_that_of_python(tab: Any, site: str, demo: Path) -> None:
    tab.goto(site)
    # a function would be called, not waited for
    tab.wait_for_function("() => Boolean(window.digests)")
    streams = [demo, *(path for path in sorted(VALID.glob("*.dgs")) if "paper" not in path.name)]
    assert len(streams) > 40
    for path in streams:
        assert tab.evaluate("(name) => window.digests(name)", path.name) == digests(path), path.name
