"""Print the blocks, or put them into the specification."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from tests.spec_example import blocks

SPEC = Path(__file__).resolve().parents[2] / "bitstream_spec.md"


def main() -> None:
    """Print or update."""
    text = SPEC.read_text(encoding="utf-8")
    for name, lines in blocks().items():
        body = "\n".join(lines)
        if "--update" in sys.argv[1:]:
            pattern = rf"(<!-- example: {name} -->\n\n```\n).*?(\n?```)"
            text = re.sub(pattern, lambda m, body=body: m[1] + body + "\n```", text, flags=re.DOTALL)
        else:
            print(body, end="\n\n")
    if "--update" in sys.argv[1:]:
        SPEC.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
