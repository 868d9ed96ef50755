"""Break `.dgs` files in ways that keep their checksums right, and see what comes of it: `make fuzz`.

Each seed takes a conformance stream apart, changes fields, lengths, steps, levels, stream bytes or the order
of chunks, puts it together again with right checksums and index, and decodes, probes and salvages it. What
may come out: frames, BitstreamError or VerificationError, in bounded time. Anything else is a bug, and its
seed is printed.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.codec.frame.limits import DecoderLimits
from dfcgs_codec.codec.frame.probe import probe_file
from dfcgs_codec.codec.frame.salvage import salvage
from dfcgs_codec.errors import BitstreamError, VerificationError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.mutations import SMALL, mutated, streams

__all__ = ["SMALL", "attempts", "outcomes", "run_seed"]
#: what a mutated file may take, in seconds of the processor
MAX_SECONDS = 3.0


def attempts(data: bytes) -> tuple[Callable[[], object], ...]:
    """What is done with a file: decoded with and without a look at hashes, in part, probed, salvaged."""
    limits = DecoderLimits(max_memory=1 << 30)

    def frames(check: bool, start: int = 0) -> None:
        for frame in SequenceDecoder(BytesIO(data), check=check, limits=limits).frames(start):
            frame.cloud()

    return (
        lambda: frames(check=True),
        lambda: frames(check=False),
        lambda: frames(check=False, start=1),
        lambda: probe_file(BytesIO(data)).as_dict(),
        lambda: list(salvage(BytesIO(data), [], limits)),
    )


def outcomes(data: bytes) -> list[str]:
    """Name of what each attempt ended with, "decoded" where nothing is wrong."""
    result = []
    for attempt in attempts(data):
        start = time.process_time()
        try:
            attempt()
            result.append("decoded")
        except (BitstreamError, VerificationError) as error:
            result.append(type(error).__name__)
        seconds = time.process_time() - start
        if seconds > MAX_SECONDS:
            raise AssertionError(f"{len(data)} bytes took {seconds:.1f} s")
    return result


def run_seed(seed: int, most_bytes: int) -> list[str]:
    """Outcomes of one seed."""
    rng = random.Random(seed)
    return outcomes(mutated(rng, rng.choice(streams(most_bytes))))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where a bug was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument(
        "--first", type=int, default=0, help="first seed; a failure is repeated with --seeds 1"
    )
    parser.add_argument("--seeds", type=int, default=1 << 40)
    asked = parser.parse_args(arguments)
    end = time.monotonic() + 60 * asked.minutes
    counts: dict[str, int] = {}
    bugs = 0
    seed = asked.first
    while seed < asked.first + asked.seeds and time.monotonic() < end:
        try:
            for outcome in run_seed(seed, 1 << 30):
                counts[outcome] = counts.get(outcome, 0) + 1
        except Exception as error:  # anything at all is what is looked for
            bugs += 1
            print(f"seed {seed}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            if asked.seeds == 1:
                raise
        seed += 1
    print(f"{seed - asked.first} seeds, {bugs} bugs; {counts}")
    return int(bugs > 0)


if __name__ == "__main__":
    sys.exit(main())
