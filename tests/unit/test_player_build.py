"""The player in the package is built from the sources that are here."""

from __future__ import annotations

import hashlib

from dfcgs_codec.player.page import SCRIPT
from tests.helpers import ROOT

PLAYER = ROOT / "player"


def test_the_build_is_of_the_sources() -> None:
    digest = hashlib.sha256()
    sources = sorted(f"src/{path.name}" for path in (PLAYER / "src").iterdir())
    for name in ("build.mjs", "package-lock.json", "package.json", *sources):
        digest.update(f"{name}\n".encode() + (PLAYER / name).read_bytes())
    first = SCRIPT.read_text().partition("\n")[0]
    assert first == f"// sources: {digest.hexdigest()}", "run `make player`"
