"""What trouble costs: `python -m evaluation.troubles`; fails where a bar is missed.

Seconds to look at the headers of 300 frames, memory and seconds of small files that ask for much, seconds of
reading one frame. Far Gaussians have a module of their own (`evaluation.experiments.far_values`).
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dfcgs_codec.ply import read_ply, write_ply
from dfcgs_codec.sequence import open_folder
from lab.bombs import BOMBS, FRESH
from lab.record import write_result
from lab.small_clouds import make_cloud

NUM_HEADERS, MOST_SECONDS_OF_HEADERS = 300, 0.5
MOST_MIB, MOST_SECONDS = 300, 2.0
_REPEATS = 5


def _median_seconds(work: Callable[[], object]) -> float:
    seconds = []
    for _ in range(_REPEATS):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return round(statistics.median(seconds), 4)


def _folders(root: Path) -> dict[str, Path]:
    """The same frames in one folder, and as trainers leave them."""
    cloud = make_cloud(50, 3)
    for index in range(NUM_HEADERS):
        tree = root / "tree" / f"frame{index:06d}" / "point_cloud" / "iteration_150"
        (root / "flat").mkdir(exist_ok=True)
        tree.mkdir(parents=True)
        write_ply(root / "flat" / f"frame_{index:04d}.ply", cloud)
        write_ply(tree / "point_cloud.ply", cloud)
    return {"flat": root / "flat", "tree": root / "tree"}


def _headers(root: Path) -> dict[str, float]:
    return {name: _median_seconds(lambda f=folder: open_folder(f)) for name, folder in _folders(root).items()}


def _bombs(root: Path) -> dict[str, Any]:
    found = {}
    for name, (make, _) in BOMBS.items():
        path = root / "bomb.dgs"
        path.write_bytes(make())
        done = subprocess.run(
            [sys.executable, "-c", FRESH, str(path)], capture_output=True, text=True, check=True
        )
        frames, error, peak, seconds = json.loads(done.stdout)
        found[name] = {
            "bytes": path.stat().st_size,
            "frames": frames,
            "error": error,
            "peak_mib": round(peak),
            "cpu_s": round(seconds, 2),
        }
        print(name, found[name], flush=True)
    return found


def _read_seconds(root: Path) -> float:
    path = root / "large.ply"
    write_ply(path, make_cloud(100_000, 3))
    return _median_seconds(lambda: read_ply(path))


def main() -> int:
    """Measure all and write the result."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        headers = _headers(root)
        results = {"headers_s": headers, "read_100k_sh3_s": _read_seconds(root), "bombs": _bombs(root)}
    bars = {"headers_s": MOST_SECONDS_OF_HEADERS, "peak_mib": MOST_MIB, "cpu_s": MOST_SECONDS}
    write_result("troubles", {"headers": NUM_HEADERS, "bars": bars}, results)
    print(headers, results["read_100k_sh3_s"])
    slow = [name for name, seconds in headers.items() if seconds > MOST_SECONDS_OF_HEADERS]
    large = [n for n, b in results["bombs"].items() if b["peak_mib"] > MOST_MIB or b["cpu_s"] > MOST_SECONDS]
    for name in (*slow, *large):
        print(f"missed: {name}", file=sys.stderr)
    return 1 if slow or large else 0


if __name__ == "__main__":
    sys.exit(main())
