"""Annex D: the worked example is what the text says."""

from __future__ import annotations

import io
import re

from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from tests import spec_decoder, spec_example
from tests.spec.checks import MODELS, bytes_of, example_block


def test_example_is_what_the_tool_makes() -> None:
    for name, lines in spec_example.blocks().items():
        assert example_block(name) == lines, f"run python -m tests.spec_example --update ({name})"
    assert bytes_of(example_block("file")) == spec_example.build()


def test_example_decodes_as_written() -> None:
    data = bytes_of(example_block("file"))
    written = dict(
        re.findall(r"^frame (\d), number \d: hash ([0-9a-f]{32})$", "\n".join(example_block("frames")), re.M)
    )
    decoded = list(SequenceDecoder(io.BytesIO(data)).frames())
    assert {str(f.index): f.state.hash().hex() for f in decoded} == written
    assert {
        str(f.index): f.state.hash().hex() for f in spec_decoder.Decoder(data, MODELS).frames()
    } == written
    assert len(written) == 2
