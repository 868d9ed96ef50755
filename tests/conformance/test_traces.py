"""Traces say what both decoders read: the package's, and that of the specification."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from dfcgs_codec.bitstream.constants import Attribute
from tests import spec_decoder
from tests.spec_decoder import RangeDecoder
from tests.spec_decoder.state import State, digest
from tools.traces import PROCEDURES, Json, Recorder, trace

FOLDER = Path(__file__).parent
NAMES = [path.stem for path in sorted((FOLDER / "traces").glob("*.json"))]


@contextmanager
def _watching(recorder: Recorder) -> Iterator[None]:
    """The decoder of the specification tells `recorder` what it reads."""
    start, decode = RangeDecoder.__init__, RangeDecoder.decode

    def init(self: RangeDecoder, data: bytes) -> None:
        start(self, data)
        recorder.begin(data)

    def read(self: RangeDecoder, model: Any) -> int:
        symbol: int = recorder.call("decode", decode, self, model)
        recorder.read([symbol])
        return symbol

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(RangeDecoder, "__init__", init))
        stack.enter_context(mock.patch.object(RangeDecoder, "decode", read))
        for name in PROCEDURES.values():
            original = getattr(RangeDecoder, name)

            def called(*arguments: Any, _of: Any = original, _as: str = name) -> Any:
                return recorder.call(_as, _of, *arguments)

            stack.enter_context(mock.patch.object(RangeDecoder, name, called))
        yield


def _planes(state: State) -> dict[str, bytes]:
    planes = {Attribute(a).name: digest(plane) for a, plane in state.planes.items()}
    if state.order is not None:
        planes["order"] = digest([[place] for place in state.order])
    return planes


def trace_of_text(data: bytes) -> list[Json]:
    """The trace of the decoder of the specification."""
    recorder, found = Recorder(data), []
    with _watching(recorder):
        for frame in spec_decoder.Decoder(data, spec_decoder.published()).frames():
            found.append(recorder.frame(frame.frame_hash, _planes(frame.state)))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_both_decoders_read_what_the_trace_says(name: str) -> None:
    expected = json.loads((FOLDER / "traces" / f"{name}.json").read_text())
    data = (FOLDER / "valid" / f"{name}.dgs").read_bytes()
    assert trace(data) == expected
    assert trace_of_text(data) == expected


def test_there_are_twelve() -> None:
    assert len(NAMES) == 12
