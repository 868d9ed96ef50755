"""Run a method of the comparison in this process: see `evaluation.baselines.method`."""

from __future__ import annotations

import sys
from pathlib import Path

from evaluation.baselines.catalogue import METHODS
from evaluation.baselines.method import MethodRefused, MethodUnavailable

EXIT_UNAVAILABLE, EXIT_REFUSED = 4, 5


def main(arguments: list[str]) -> int:
    """0 when done; 4 and 5 with a line on stderr where the method is unavailable or refuses."""
    direction, name, *rest = arguments
    method = METHODS[name]
    try:
        if direction == "encode":
            setting, frames, target = rest
            method.encode(Path(frames), Path(target), setting)
        else:
            target, frames = rest
            method.decode(Path(target), Path(frames))
    except MethodUnavailable as error:
        print(error, file=sys.stderr)
        return EXIT_UNAVAILABLE
    except MethodRefused as error:
        print(error, file=sys.stderr)
        return EXIT_REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
