"""The player in a real browser."""

from __future__ import annotations

import random
import re
import socket
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import decode_sequence
from dfcgs_codec.player.server import PlayerServer
from tests.helpers import dfcgs
from tests.player.conftest import NOTE, NUM_FRAMES, PLAYER, SIZE, served, until

VALID = Path(__file__).parents[1] / "conformance" / "valid"
#: decibels
LEAST_PSNR = 40.0
Watch = Callable[[str], Any]


def seek(tab: Any, frame: int) -> None:
    tab.evaluate(f"{PLAYER}.seek({frame})")
    until(tab, f"{PLAYER}.isSettled && {PLAYER}.shown === {frame}")


def picture(tab: Any) -> np.ndarray:
    """What is on the screen, (H, W, 3) float64 from 0 to 1."""
    image = pytest.importorskip("PIL.Image")
    return np.asarray(image.open(BytesIO(tab.screenshot())).convert("RGB"), np.float64) / 255


def expected_picture(tab: Any, path: Path, frame: int) -> np.ndarray:
    """The same from the CPU renderer."""
    pytest.importorskip("numba")
    from lab.render import Camera, render

    lens = tab.evaluate(f"{PLAYER}.camera.lens({SIZE['width']}, {SIZE['height']})")
    size = (lens["width"], lens["height"])
    pose = np.array(lens["view"]).reshape(4, 4)
    camera = Camera(pose, lens["focal"], lens["focal"], size[0] / 2, size[1] / 2, *size)
    return np.clip(render(next(iter(decode_sequence(path, frame, frame + 1))).cloud(), camera).colour, 0, 1)


@pytest.mark.parametrize(("azimuth", "elevation", "frame"), [(0.3, 0.2, 0), (2.5, 0.7, 5), (4.4, -0.3, 3)])
def test_pictures_are_those_of_the_cpu_renderer(
    watch: Watch, demo: Path, azimuth: float, elevation: float, frame: int
) -> None:
    with served(demo) as url:
        tab = watch(url)
        seek(tab, frame)
        pose = f"Object.assign({PLAYER}.camera.pose, {{azimuth: {azimuth}, elevation: {elevation}}})"
        tab.evaluate(f"document.querySelector('dfcgs-player').removeAttribute('controls'); {pose}")
        tab.evaluate(f"{PLAYER}.moved()")
        until(tab, f"{PLAYER}.isSettled")
        found, expected = picture(tab), expected_picture(tab, demo, frame)
    assert expected.std() > 0.05
    assert -10 * np.log10(np.mean((found - expected) ** 2)) >= LEAST_PSNR


def test_it_plays_every_frame_and_goes_on_from_the_start(watch: Watch, demo: Path) -> None:
    with served(demo) as url:
        tab = watch(url)
        tab.evaluate(f"window.seen = []; {PLAYER}.speed = 0.1")
        element = "document.querySelector('dfcgs-player')"
        tab.evaluate(f"{element}.addEventListener('frame', () => window.seen.push({PLAYER}.shown))")
        tab.evaluate(f"{PLAYER}.play()")
        is_back = "window.seen.some((one, i) => one < window.seen[i - 1])"
        until(tab, f"new Set(window.seen).size === {NUM_FRAMES} && {is_back}")


def test_fifty_seeks(watch: Watch, demo: Path) -> None:
    chance = random.Random(1)
    with served(demo) as url:
        tab = watch(url)
        for _ in range(50):
            seek(tab, chance.randrange(NUM_FRAMES))


@pytest.mark.parametrize("name", ["births_and_deaths", "verbatim_sh1", "empty_frames", "float64_from_origin"])
def test_streams_of_all_kinds_play(watch: Watch, name: str) -> None:
    path = VALID / f"{name}.dgs"
    with served(path) as url:
        tab = watch(url)
        for frame in decode_sequence(path):
            seek(tab, frame.index)
            assert tab.evaluate(f"{PLAYER}.statistics.gaussians") == frame.cloud().num_gaussians


def damaged(demo: Path, target: Path) -> Path:
    """One bit is wrong in the second GoF."""
    data = bytearray(demo.read_bytes())
    data[len(data) * 3 // 4] ^= 1
    target.write_bytes(data)
    return target


def test_a_damaged_file_says_so_and_plays_what_is_whole(watch: Watch, demo: Path, tmp_path: Path) -> None:
    with served(damaged(demo, tmp_path / "damaged.dgs")) as url:
        tab = watch(url)
        tab.evaluate(f"{PLAYER}.seek({NUM_FRAMES - 1})")
        until(tab, f"!{NOTE}.hidden")
        assert tab.get_by_role("alert").locator("code").text_content() == "corrupt"
        assert "damaged" in tab.get_by_role("alert").text_content()
        seek(tab, 1)
        until(tab, f"{NOTE}.hidden")


@pytest.mark.parametrize(
    ("start", "stop", "code"), [(0, 1000, "truncated"), (1, None, "not-a-dgs-file"), (0, 0, "truncated")]
)
def test_what_is_no_whole_file(
    tab: Any, demo: Path, tmp_path: Path, start: int, stop: int | None, code: str
) -> None:
    (tmp_path / "part.dgs").write_bytes(demo.read_bytes()[start:stop])
    with served(tmp_path / "part.dgs") as url:
        tab.goto(url)
        until(tab, f"!{NOTE}.hidden")
        assert tab.get_by_role("alert").locator("code").text_content() == code


def test_profile_paper_is_refused_with_words(tab: Any) -> None:
    with served(VALID / "paper.dgs") as url:
        tab.goto(url)
        until(tab, f"!{NOTE}.hidden")
        assert "profile paper" in tab.get_by_role("alert").text_content()


class CuttingServer(PlayerServer):
    """Cuts the connection at every other request for the file."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        requests = iter(range(1 << 30))

        class Cutting(self.RequestHandlerClass):  # type: ignore[misc, name-defined]
            def do_GET(self) -> None:  # noqa: N802 - the standard library's name
                if self.path.endswith(".dgs") and next(requests) % 2 == 0:
                    self.close_connection = True
                    self.connection.shutdown(socket.SHUT_RDWR)
                else:
                    super().do_GET()

        self.RequestHandlerClass = Cutting


def test_connections_that_are_cut_are_made_again(watch: Watch, demo: Path) -> None:
    with served(demo, kind=CuttingServer) as url:
        seek(watch(url), NUM_FRAMES - 1)


def test_a_page_from_the_disk_plays(watch: Watch, demo: Path, tmp_path: Path) -> None:
    assert dfcgs("export", demo, tmp_path / "page.html").returncode == 0
    seek(watch((tmp_path / "page.html").as_uri()), NUM_FRAMES - 1)


def test_a_linked_page_from_the_disk_asks_for_the_file(tab: Any, demo: Path, tmp_path: Path) -> None:
    assert dfcgs("export", demo, tmp_path / "page.html", "--link").returncode == 0
    tab.goto((tmp_path / "page.html").as_uri())
    until(tab, f"!{NOTE}.hidden")
    with tab.expect_file_chooser() as chooser:
        tab.get_by_role("button", name="Choose the file").click()
    chooser.value.set_files(demo)
    until(tab, f"{PLAYER}.shown >= 0 && {NOTE}.hidden")


def test_two_players_move_together(watch: Watch, demo: Path) -> None:
    with served(demo, demo) as url:
        tab = watch(url)
        other = PLAYER.replace("querySelector('dfcgs-player')", "querySelectorAll('dfcgs-player')[1]")
        until(tab, f"{other}.shown >= 0")
        seek(tab, 3)
        until(tab, f"{other}.shown === 3")
        tab.evaluate(f"{PLAYER}.camera.orbit(1, 0.2); {PLAYER}.moved()")
        poses = f"[{PLAYER}, {other}].map((one) => JSON.stringify(one.camera.pose))"
        assert len(set(tab.evaluate(poses))) == 1


def test_keys_and_names(watch: Watch, demo: Path) -> None:
    with served(demo) as url:
        tab = watch(url)
        seek(tab, 2)
        tab.get_by_role("application").focus()
        tab.keyboard.press("ArrowRight")
        until(tab, f"{PLAYER}.shown === 3")
        tab.keyboard.press("End")
        until(tab, f"{PLAYER}.shown === {NUM_FRAMES - 1}")
        tab.keyboard.press("Space")
        assert tab.get_by_role("button", name="Pause").count() == 1
        tab.keyboard.press("Space")
        tab.keyboard.press("l")
        assert tab.get_by_role("button", name="Loop").get_attribute("aria-pressed") == "false"
        tab.get_by_role("button", name="Settings").click()
        for label in ("Speed", "Upwards", "Colours (SH degree)", "Size of Gaussians", "Statistics"):
            assert tab.get_by_label(label, exact=True).count() == 1, label
        names = tab.evaluate(
            "[...document.querySelector('dfcgs-player').shadowRoot.querySelectorAll('button')]"
            ".map((one) => one.getAttribute('aria-label'))"
        )
        assert all(names)


def test_it_fits_a_phone(watch: Watch, demo: Path) -> None:
    with served(demo) as url:
        tab = watch(url)
        tab.set_viewport_size({"width": 360, "height": 640})
        assert tab.evaluate("document.documentElement.scrollWidth") <= 360
        for control in tab.get_by_role("button").all():
            box = control.bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 360


def test_without_webgl2_it_says_so(tab: Any, demo: Path) -> None:
    tab.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    with served(demo) as url:
        tab.goto(url)
        assert re.search("WebGL2", tab.get_by_role("alert").text_content())
