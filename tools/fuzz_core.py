"""Break files for the C core under sanitizers: `make fuzz-core`.

    python tools/fuzz_core.py [--seconds N] [--first SEED]

The core is built natively with the sanitizers of addresses and undefined behaviour. With clang, libFuzzer
breaks files under any checksums, beginning with the conformance streams and with what the project's own
mutator makes of them; with gcc the mutator alone does. A crash ends the run, and its file is kept.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

from dfcgs_codec.model import registry
from dfcgs_codec.model.core_words import words_of

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.mutations import FOLDER, mutated, streams

SOURCES = Path(__file__).resolve().parents[1] / "core"
#: files a run of the program
BATCH = 200
#: bytes of the streams that are broken
MOST_BYTES = 20_000
_FLAGS = ["-std=c11", "-O1", "-g", "-fwrapv", "-fno-omit-frame-pointer", "-fno-sanitize-recover=all"]


def compiler() -> str | None:
    """clang, which brings libFuzzer, if it is there."""
    found = (shutil.which(f"clang{version}") for version in ("", *(f"-{n}" for n in range(22, 12, -1))))
    return next((path for path in found if path), None)


def build(program: Path) -> bool:
    """Build the program of core/fuzz/decode.c; whether libFuzzer is in it."""
    clang = compiler()
    sources = [*sorted(SOURCES.glob("*.c")), SOURCES / "fuzz" / "decode.c"]
    sanitizers = "address,undefined" + (",fuzzer" if clang else "")
    command = [clang or "gcc", *_FLAGS, f"-fsanitize={sanitizers}", *map(str, sources)]
    subprocess.run(
        [
            *command,
            *(["-DDFCGS_LIBFUZZER", "-DDFCGS_ANY_CHECKSUM"] if clang else []),
            "-o",
            str(program),
            "-lm",
        ],
        check=True,
    )
    return clang is not None


def environment(folder: Path) -> dict[str, str]:
    """What the program is told of the model."""
    model = registry.context_model(registry.DEFAULT_PRIOR)
    words = words_of(model)
    assert words is not None
    (folder / "words").write_bytes(words)
    told = {"DFCGS_WORDS": str(folder / "words"), "DFCGS_HASH": model.digest[:8].hex()}
    return os.environ | told | {"ASAN_OPTIONS": "detect_leaks=0"}


def broken(folder: Path, first: int, count: int) -> list[Path]:
    """Files of the mutator's seeds."""
    files = []
    for seed in range(first, first + count):
        rng = random.Random(seed)
        files.append(folder / f"{seed}.dgs")
        files[-1].write_bytes(mutated(rng, rng.choice(streams(MOST_BYTES))))
    return files


def by_mutator(program: Path, folder: Path, first: int, seconds: float) -> int:
    """Run the program on batch after batch of broken files; how many files that were."""
    end, seed, told = time.monotonic() + seconds, first, environment(folder)
    while time.monotonic() < end:
        files = broken(folder, seed, BATCH)
        subprocess.run([program, *files], check=True, env=told, stdout=subprocess.DEVNULL, timeout=600)
        for file in files:
            file.unlink()
        seed += BATCH
    return seed - first


def by_libfuzzer(program: Path, folder: Path, first: int, seconds: float) -> None:
    """Let libFuzzer go on from the conformance streams and some broken files."""
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    for path in FOLDER.glob("*.dgs"):
        if path.stat().st_size <= MOST_BYTES:
            shutil.copy(path, corpus)
    broken(corpus, first, BATCH)
    options = [f"-max_total_time={seconds:.0f}", "-timeout=30", "-rss_limit_mb=3000", "-max_len=40000"]
    told = environment(folder)
    subprocess.run([program, *options, f"-artifact_prefix={folder}/", corpus], check=True, env=told)


def main() -> None:
    """Build, then break files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("out") / "fuzz-core")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    folder = options.folder.resolve()
    has_libfuzzer = build(folder / "decode")
    if has_libfuzzer:
        by_libfuzzer(folder / "decode", folder, options.first, options.seconds)
    else:
        print(by_mutator(folder / "decode", folder, options.first, options.seconds), "files")


if __name__ == "__main__":
    main()
