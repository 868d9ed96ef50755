"""Fit a sequence, or more frames of one: `python -m training.fitting NAME`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from dfcgs_codec.errors import InputError
from lab.assets import STORED
from lab.record import known_results
from training.fitting.fit import fit_sequence
from training.fitting.report import RESULT, write_report
from training.fitting.sequences import FITTED


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m training.fitting",
        description="Fit a sequence of Gaussian frames to images; a file that is there is continued.",
    )
    parser.add_argument("name", choices=sorted(FITTED))
    parser.add_argument("--frames", type=int, default=20, help="how many the file has in the end, default 20")
    parser.add_argument(
        "--out", type=Path, help="default assets/fitted/NAME.zip, with a report in evaluation/"
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when done, 1 for bad input."""
    args = build_parser().parse_args(arguments)
    path = args.out or STORED / f"{args.name}.zip"
    earlier = known_results(RESULT).get(args.name, {"frames": []})["frames"] if args.out is None else []
    rows = []
    try:
        for row in fit_sequence(FITTED[args.name], args.frames, path, [r["seconds"] for r in earlier]):
            rows.append(row)
            print("  ".join(f"{key} {value}" for key, value in row.items()), file=sys.stderr, flush=True)
            if args.out is None and len(rows) >= len(earlier):
                write_report(args.name, path, rows)
    except (InputError, FileNotFoundError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"{path}: {len(rows)} frames, {path.stat().st_size} bytes", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
