"""A browser, and what it looks at."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from dfcgs_codec import EncoderOptions
from dfcgs_codec.player.page import Shown, page
from dfcgs_codec.player.server import PlayerServer
from lab.small_clouds import drifting, real_cloud
from tests.helpers import encode

NUM_FRAMES, GOF_SIZE = 8, 4
SIZE = {"width": 640, "height": 480}
#: seconds for anything that a page does, on a loaded machine
PATIENCE = 120.0
_NAMES = ("chromium", "chromium-browser", "google-chrome")
#: a graphics card in software, without a screen
_FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_FLAGS += ["--ignore-gpu-blocklist", "--force-color-profile=srgb", "--disable-background-networking"]


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip("no chromium on this machine: CHROMIUM names one")
    with sync_api.sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=found, args=_FLAGS, timeout=PATIENCE * 1000)
        yield made
        made.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    """A page in the browser; the test fails where its scripts do."""
    made = browser.new_page(viewport=SIZE, device_scale_factor=1)
    made.set_default_timeout(PATIENCE * 1000)
    errors: list[str] = []
    made.on("pageerror", lambda error: errors.append(str(error)))
    yield made
    made.close()
    assert not errors


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames of 2000 Gaussians in two GoFs."""
    path = tmp_path_factory.mktemp("demo") / "demo.dgs"
    encode(drifting(real_cloud(2000), NUM_FRAMES), path, EncoderOptions(gof_size=GOF_SIZE))
    return path


@contextmanager
def served(*files: Path, kind: type[PlayerServer] = PlayerServer) -> Iterator[str]:
    """The address of a page that shows these files."""
    names = [f"{i}.dgs" for i in range(len(files))]
    shown = [Shown(file.name, url=name) for file, name in zip(files, names, strict=True)]
    server = kind("".join(page(shown, "+y")).encode(), dict(zip(names, files, strict=True)))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server.url
    server.shutdown()
    thread.join()
    server.server_close()


def until(tab: Any, condition: str) -> None:
    """Wait until the expression is true; the page's policy forbids what playwright has for this."""
    end = time.monotonic() + PATIENCE
    while not tab.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: {tab.evaluate(STATE)}"
        time.sleep(0.05)


PLAYER = "document.querySelector('dfcgs-player').player"
NOTE = "document.querySelector('dfcgs-player').shadowRoot.querySelector('.note')"
STATE = f"JSON.stringify([{PLAYER}?.shown, {PLAYER}?.frame, {PLAYER}?.isPlaying, {NOTE}.textContent])"


@pytest.fixture
def watch(tab: Any) -> Callable[[str], Any]:
    """Opens an address and waits for the first picture; it stands still."""

    def opened(url: str) -> Any:
        tab.goto(url)
        until(tab, f"{PLAYER}.shown >= 0")
        tab.evaluate(f"{PLAYER}.pause()")
        return tab

    return opened
