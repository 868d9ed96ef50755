"""Write all tables into their pages: `python -m evaluation.tables`."""

from __future__ import annotations

from evaluation.tables import field, readme, results


def main() -> None:
    """docs/results.md, docs/field.md and README.md."""
    for page in (results, field, readme):
        page.PAGE.write_text(page.filled(page.PAGE.read_text()))


if __name__ == "__main__":
    main()
