"""The worked example of bitstream_spec.md, annex D: a file, its fields, what is read and what comes of it.

python -m tests.spec_example             print the blocks of the annex
python -m tests.spec_example --update    put them into bitstream_spec.md
"""

from __future__ import annotations

from tests.spec_example.content import build
from tests.spec_example.decoding import described
from tests.spec_example.fields import annotate

__all__ = ["blocks", "build"]


def blocks() -> dict[str, list[str]]:
    """The annex's blocks by name."""
    data = build()
    return {"file": annotate(data), **described(data)}
