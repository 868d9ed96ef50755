"""Build the C core (core/) to the WebAssembly module of the package, with the compiler of `ziglang`.

    python tools/build_core.py [TARGET]

The same sources and the same version of ziglang give the same bytes on every machine.
"""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCES = ROOT / "core"
MODULE = ROOT / "src" / "dfcgs_codec" / "core" / "core.wasm"
#: another version may make other bytes
COMPILER = "0.17.1"

_FLAGS = [
    *("-target", "wasm32-freestanding", "-mcpu=generic+simd128+bulk_memory+bulk_memory_opt"),
    # overflow wraps, as it does in numpy
    *("-std=c11", "-O3", "-fwrapv", "-Wall", "-Wextra", "-Werror"),
    *("-fvisibility=hidden", "-nostdlib", "-g0"),
    *("-Wl,--no-entry", "-Wl,--export-dynamic", "-Wl,--strip-all", "-Wl,-z,stack-size=262144"),
]


def build(target: Path) -> None:
    """Compile all sources into `target`; RuntimeError with another compiler than the one that is pinned."""
    found = importlib.metadata.version("ziglang")
    if found != COMPILER:
        raise RuntimeError(f"ziglang {found} is installed, {COMPILER} is needed")
    sources = sorted(path.name for path in SOURCES.glob("*.c"))
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "core.wasm"
        command = [sys.executable, "-m", "ziglang", "cc", *_FLAGS, *sources, "-o", str(made)]
        subprocess.run(command, check=True, cwd=SOURCES)
        target.write_bytes(made.read_bytes())


if __name__ == "__main__":
    where = Path(sys.argv[1]) if len(sys.argv) > 1 else MODULE
    build(where)
    print(f"{where}: {where.stat().st_size} bytes")
