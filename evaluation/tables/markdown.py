"""What all tables are made with: rows as Markdown, and their places in pages."""

from __future__ import annotations


def table(head: list[str], rows: list[list[str]]) -> str:
    """Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def decibel(psnr: float | None, equal: str = "equal images") -> str:
    """One digit; None stands for images without any difference."""
    return equal if psnr is None else f"{psnr:.1f}"


def replace_between(text: str, name: str, body: str) -> str:
    """`text` with what stands between the marks of `name` replaced; raises ValueError without marks."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, found, rest = text.partition(start)
    _, ended, tail = rest.partition(end)
    if not found or not ended:
        raise ValueError(f"the page has no marks for the table {name!r}")
    return f"{head}{start}{body}{end}{tail}"
