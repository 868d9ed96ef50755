"""`dfcgs view`: the page and its files are served, whole and in parts, and nothing else is."""

from __future__ import annotations

import http.client
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from dfcgs_codec.player.page import Shown, page
from dfcgs_codec.player.server import HOST, PlayerServer, byte_range
from tests.helpers import dfcgs

DATA = bytes(range(256)) * 500
SIZE = len(DATA)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PlayerServer]:
    (tmp_path / "scene.dgs").write_bytes(DATA)
    (tmp_path / "secret.txt").write_text("not to be had")
    made = PlayerServer(b"<p>page", {"0.dgs": tmp_path / "scene.dgs"})
    thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield made
    made.shutdown()
    thread.join()
    made.server_close()


def answer(
    server: PlayerServer, path: str, method: str = "GET", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection(HOST, server.server_address[1], timeout=30)
    connection.request(method, path, headers=headers)
    response = connection.getresponse()
    body = response.read()
    connection.close()
    return response.status, dict(response.getheaders()), body


def test_the_page_and_its_file(server: PlayerServer) -> None:
    root = urlsplit(server.url).path
    status, headers, body = answer(server, root)
    assert (status, body) == (200, b"<p>page")
    assert headers["Content-Type"].startswith("text/html")
    status, headers, body = answer(server, f"{root}0.dgs")
    assert (status, body) == (200, DATA)
    assert headers["Accept-Ranges"] == "bytes"
    assert answer(server, f"{root}0.dgs", "HEAD")[2] == b""


@pytest.mark.parametrize(
    ("header", "start", "stop"),
    [
        ("bytes=0-99", 0, 100),
        ("bytes=1000-", 1000, SIZE),
        ("bytes=-15", SIZE - 15, SIZE),
        ("bytes=5-5", 5, 6),
    ],
)
def test_parts(server: PlayerServer, header: str, start: int, stop: int) -> None:
    status, headers, body = answer(server, f"{urlsplit(server.url).path}0.dgs", Range=header)
    assert (status, body) == (206, DATA[start:stop])
    assert headers["Content-Range"] == f"bytes {start}-{stop - 1}/{SIZE}"


def test_a_part_that_is_not_there(server: PlayerServer) -> None:
    status, headers, body = answer(server, f"{urlsplit(server.url).path}0.dgs", Range=f"bytes={SIZE}-")
    assert (status, body) == (416, b"")
    assert headers["Content-Range"] == f"bytes */{SIZE}"


@pytest.mark.parametrize("header", [None, "", "bytes=-", "lines=1-2", "bytes=1-2,5-6", "bytes=a-b"])
def test_ranges_that_are_not_known_get_the_whole(header: str | None) -> None:
    assert byte_range(header, 100) is None


def test_nothing_else_is_reachable(server: PlayerServer) -> None:
    root = urlsplit(server.url).path
    others = [
        "/",
        "/0.dgs",
        root[:-1],
        f"{root[:-2]}/",
        f"{root}secret.txt",
        f"{root}scene.dgs",
        f"{root}1.dgs",
    ]
    others += [
        f"{root}../secret.txt",
        f"{root}%2e%2e/secret.txt",
        f"{root}/etc/passwd",
        f"{root}0.dgs/../secret.txt",
    ]
    for path in others:
        status, _, body = answer(server, path)
        assert (status, body) == (404, b""), path
    assert answer(server, root, "POST")[0] == 501


def test_only_this_machine_is_served_under_an_address_nobody_guesses(server: PlayerServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    other = PlayerServer(b"", {})
    other.server_close()
    assert len(server.token) >= 20
    assert server.token != other.token


def test_a_file_that_is_gone(server: PlayerServer) -> None:
    server.files["0.dgs"].unlink()
    assert answer(server, f"{urlsplit(server.url).path}0.dgs")[0] == 410


def test_names_break_out_of_nothing() -> None:
    text = "".join(page([Shown("</script><b>&'\"", url="0.dgs")]))
    assert "<b>" not in text
    assert "<title>&lt;/script&gt;&lt;b&gt;" in text


@contextmanager
def viewing(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`dfcgs view` without a browser, and the address that it prints."""
    command = [sys.executable, "-m", "dfcgs_codec", "view", "--no-browser", "--quiet", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def fetched(url: str) -> bytes:
    place = urlsplit(url)
    connection = http.client.HTTPConnection(HOST, place.port, timeout=30)
    connection.request("GET", place.path)
    return connection.getresponse().read()


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_file_is_viewed_until_ctrl_c(stream: Path) -> None:
    with viewing(stream) as (process, url):
        text = fetched(url).decode()
        assert '"name": "scene.dgs", "url": "0.dgs"' in text
        assert fetched(f"{url}0.dgs") == stream.read_bytes()
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0


def test_a_folder_is_viewed_beside_a_file(frames_dir: Path, stream: Path) -> None:
    with viewing(frames_dir, stream) as (_, url):
        assert re.findall(r'"url": "(.)\.dgs"', fetched(url).decode()) == ["0", "1"]
        assert fetched(f"{url}0.dgs")[:4] == b"\x89DGS"
        assert fetched(f"{url}1.dgs") == stream.read_bytes()


def test_what_cannot_be_viewed(stream: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.dgs"
    damaged.write_bytes(b"ply\n")
    done = dfcgs("view", damaged, "--no-browser")
    assert done.returncode == 3
    assert "[not-a-dgs-file]" in done.stderr
    assert dfcgs("view", stream, stream, stream).returncode == 2
    assert dfcgs("view", tmp_path / "nothing.dgs").returncode == 2


def test_a_port_that_is_taken(server: PlayerServer, stream: Path) -> None:
    port = server.server_address[1]
    done = dfcgs("view", stream, "--no-browser", "--port", str(port))
    assert done.returncode == 1
    assert f"port {port}" in done.stderr
