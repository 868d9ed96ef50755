"""Traces of conformance streams: what a decoder reads, call by call, and what it arrives at.

`make golden` writes them to tests/conformance/traces, from the package's decoder; tests/conformance/README.md
says what is in them. `python -m tools.traces FILE` prints that of any file.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.entropy import symbols
from dfcgs_codec.entropy.coder import RangeReader

Json = dict[str, Any]
#: functions of the package, and the procedures of chapter 10 that they are
PROCEDURES = {
    "code_bits": "bits",
    "code_escapes": "escapes",
    "code_with_models": "grouped",
    "code_residuals": "residuals",
}
_PASS_DIGEST, _STREAM_DIGEST = 4, 16


def _digest(values: Sequence[int], size: int) -> str:
    return hashlib.blake2b(np.asarray(values, "<i8").tobytes(), digest_size=size).hexdigest()


@dataclass
class _Stream:
    """The bytes of a stream, its symbols, and its passes as the trace writes them."""

    data: bytes
    symbols: list[int] = field(default_factory=list)
    passes: list[str] = field(default_factory=list)

    def as_dict(self) -> Json:
        digest = _digest(self.symbols, _STREAM_DIGEST)
        return {"symbols": len(self.symbols), "digest": digest, "passes": self.passes}


class Recorder:
    """Looks on while the streams of `file` are decoded one after the other."""

    def __init__(self, file: bytes) -> None:
        self._file = file
        self._start = 0
        self._streams: list[_Stream] = []
        self._depth = 0

    def begin(self, data: bytes) -> None:
        """The stream `data` begins."""
        self._streams.append(_Stream(data))

    def read(self, values: Sequence[int]) -> None:
        """Symbols of the range decoder."""
        self._streams[-1].symbols += values

    def call(self, name: str, procedure: Callable[..., Any], *arguments: Any) -> Any:
        """What `procedure` returns; a line of the trace if no other procedure called it."""
        self._depth += 1
        values = procedure(*arguments)
        self._depth -= 1
        if self._depth == 0:
            listed = np.atleast_1d(values).tolist()
            if listed:
                self._streams[-1].passes.append(f"{name} {len(listed)} {_digest(listed, _PASS_DIGEST)}")
        return values

    def frame(self, frame_hash: bytes, planes: dict[str, bytes]) -> Json:
        """The part of the trace that belongs to a frame, once it is decoded."""
        self._start = self._file.index(frame_hash, self._start) + 1
        # decoders are free to read births when they need them
        ordered = sorted(self._streams, key=lambda stream: self._file.index(stream.data, self._start))
        streams = [stream.as_dict() for stream in ordered if stream.symbols]
        self._streams = []
        digests = {name: digest.hex() for name, digest in planes.items()}
        return {"hash": frame_hash.hex(), "planes": digests, "streams": streams}


@contextmanager
def _watching(recorder: Recorder) -> Iterator[None]:
    """The package's decoder tells `recorder` what it reads."""
    start, code = RangeReader.__init__, RangeReader.code

    def init(self: RangeReader, data: bytes, *arguments: Any) -> None:
        start(self, data, *arguments)
        recorder.begin(bytes(data))

    def decode(self: RangeReader, *arguments: Any) -> Any:
        values = recorder.call("decode", code, self, *arguments)
        recorder.read(values.tolist())
        return values

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(RangeReader, "__init__", init))
        stack.enter_context(mock.patch.object(RangeReader, "code", decode))
        for name, procedure in PROCEDURES.items():
            original = getattr(symbols, name)

            def called(*arguments: Any, _of: Any = original, _as: str = procedure) -> Any:
                return recorder.call(_as, _of, *arguments)

            for module in [m for key, m in sys.modules.items() if key.startswith("dfcgs_codec.")]:
                if getattr(module, name, None) is original:
                    stack.enter_context(mock.patch.object(module, name, called))
        yield


def as_text(frames: list[Json]) -> str:
    """JSON with a stream a line."""
    parts = []
    for frame in frames:
        streams = ",\n".join("  " + json.dumps(stream) for stream in frame["streams"])
        head = json.dumps({"hash": frame["hash"], "planes": frame["planes"]})[:-1]
        parts.append(f' {head}, "streams": [\n{streams}]}}')
    return "[\n" + ",\n".join(parts) + "\n]\n"


def trace(data: bytes) -> list[Json]:
    """Of each frame of a file."""
    recorder, found = Recorder(data), []
    # the decoder whose every call can be watched
    with mock.patch.dict(os.environ, {"DFCGS_ENGINE": "numpy"}), _watching(recorder):
        for frame in SequenceDecoder(BytesIO(data)).frames():
            planes = {a.name: plane.digest for a, plane in frame.state.planes.items()}
            if frame.state.order is not None:
                planes["order"] = frame.state.order.digest
            found.append(recorder.frame(frame.state.hash(), planes))
    return found


if __name__ == "__main__":
    print(as_text(trace(Path(sys.argv[1]).read_bytes())), end="")
