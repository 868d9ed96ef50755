"""Serves one page and the files that it shows on 127.0.0.1, and nothing else of the disk."""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

HOST = "127.0.0.1"
_BLOCK = 1 << 16
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


def byte_range(header: str | None, size: int) -> tuple[int, int] | None:
    """First byte, and the one after the last, that a Range header asks for of `size` bytes.

    None where the whole is sent: without a header, or with one of a kind that is not known here. What does
    not lie in the file is empty.
    """
    found = _RANGE.fullmatch(header.strip()) if header else None
    if found is None or not any(found.groups()):
        return None
    first, last = found.groups()
    if not first:
        return max(0, size - int(last)), size
    stop = min(size, int(last) + 1) if last else size
    return (int(first), stop) if int(first) < stop else (size, size)


class _Handler(BaseHTTPRequestHandler):
    """Answers the few addresses that there are."""

    server: PlayerServer
    protocol_version = "HTTP/1.1"
    #: seconds after which a silent connection is given up
    timeout = 60

    def do_GET(self) -> None:
        """The page, or a part of a file."""
        with suppress(ConnectionError, TimeoutError):
            self._answer(has_body=True)

    def do_HEAD(self) -> None:
        """The same without its bytes."""
        with suppress(ConnectionError, TimeoutError):
            self._answer(has_body=False)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing is said of requests."""

    def _answer(self, *, has_body: bool) -> None:
        prefix = f"/{self.server.token}/"
        name = self.path.removeprefix(prefix)
        if not self.path.startswith(prefix):
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not name:
            self._send_page(has_body)
        elif name in self.server.files:
            self._send_file(self.server.files[name], has_body)
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def _refuse(self, status: HTTPStatus, **headers: str) -> None:
        self._begin(status, 0, "text/plain", **headers)

    def _begin(self, status: HTTPStatus, length: int, kind: str, **headers: str) -> None:
        self.send_response(status)
        always = {"Content-Type": kind, "Content-Length": str(length), "Cache-Control": "no-store"}
        safe = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
        for name, value in {**always, **safe, **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def _send_page(self, has_body: bool) -> None:
        self._begin(HTTPStatus.OK, len(self.server.page), "text/html; charset=utf-8")
        if has_body:
            self.wfile.write(self.server.page)

    def _send_file(self, path: Path, has_body: bool) -> None:
        try:
            file = path.open("rb")
        except OSError:
            return self._refuse(HTTPStatus.GONE)
        with file:
            size = file.seek(0, 2)
            part = byte_range(self.headers["Range"], size)
            start, stop = part or (0, size)
            if part and start == stop:
                return self._refuse(
                    HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, Content_Range=f"bytes */{size}"
                )
            status = HTTPStatus.PARTIAL_CONTENT if part else HTTPStatus.OK
            ranges = {"Accept_Ranges": "bytes"}
            if part:
                ranges["Content_Range"] = f"bytes {start}-{stop - 1}/{size}"
            self._begin(status, stop - start, "application/octet-stream", **ranges)
            file.seek(start)
            left = stop - start if has_body else 0
            while left and (block := file.read(min(_BLOCK, left))):
                self.wfile.write(block)
                left -= len(block)


class PlayerServer(ThreadingHTTPServer):
    """`page` at the address `url`, and beside it `files` by their names; OSError where the port is taken."""

    daemon_threads = True

    def __init__(self, page: bytes, files: Mapping[str, Path], port: int = 0) -> None:
        self.page, self.files = page, dict(files)
        # whoever cannot read the address cannot read the scene, other users of the machine included
        self.token = secrets.token_urlsafe(16)
        super().__init__((HOST, port), _Handler)

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.server_address[1]}/{self.token}/"
