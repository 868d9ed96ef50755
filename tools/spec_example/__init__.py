"""The worked example of bitstream_spec.md, annex D: a file, its fields, what is read and what comes of it.

python -m tools.spec_example             print the blocks of the annex
python -m tools.spec_example --update    put them into bitstream_spec.md
"""

from __future__ import annotations

from tools.spec_example.content import build
from tools.spec_example.decoding import described
from tools.spec_example.fields import annotate

__all__ = ["blocks", "build"]


def blocks() -> dict[str, list[str]]:
    """The annex's blocks by name."""
    data = build()
    return {"file": annotate(data), **described(data)}
