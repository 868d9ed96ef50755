"""Write all tables into their pages: `python -m evaluation.tables`."""

from __future__ import annotations

from evaluation.tables.pages import filled, pages


def main() -> None:
    """README.md and all of docs/; a page without tables is left alone."""
    for page in pages():
        text = page.read_text()
        if (new := filled(text)) != text:
            page.write_text(new)
            print(page)


if __name__ == "__main__":
    main()
