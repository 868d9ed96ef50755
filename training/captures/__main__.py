"""Fit captures: `python -m training.captures [NAME ...]`; goes on where it stopped."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from dfcgs_codec.errors import InputError
from lab.assets import STORED
from lab.captures.captures import CAPTURES
from training.captures.fit import fit_capture


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m training.captures",
        description="Fit captures of rooms; what is there, a checkpoint included, is continued.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default all: {', '.join(CAPTURES)}")
    parser.add_argument("--frames", type=int, default=20, help="how many a file has in the end, default 20")
    parser.add_argument("--out", type=Path, default=STORED, help="folder of the files, default assets/fitted")
    return parser


def talk(step: int, loss: float, count: int) -> None:
    """Say now and then how frame 0 comes along."""
    if step % 250 == 0:
        print(f"step {step}  loss {loss:.4f}  {count} Gaussians", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when done, 1 for bad input."""
    args = build_parser().parse_args(arguments)
    try:
        for name in args.names or CAPTURES:
            if name not in CAPTURES:
                raise InputError(f"no capture {name!r}; there are {', '.join(CAPTURES)}")
            for row in fit_capture(name, CAPTURES[name], args.frames, args.out, talk):
                print(name, *(f"{key} {value} " for key, value in row.items()), file=sys.stderr, flush=True)
    except (InputError, FileNotFoundError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
