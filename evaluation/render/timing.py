"""Times of the renderer on this machine: `python -m evaluation.render.timing [--json]`.

The scene is a ball of random Gaussians, SH degree 3, seen whole; each figure is the best of several runs. The
first line is the time to the first image and gradient here: compilation, unless `__pycache__` has it.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dfcgs_codec.gaussians import GaussianCloud
from evaluation.render import orbit, render, render_backward, ssim_with_gradient
from evaluation.render.kernel import available_threads

CASES = ((50_000, (320, 240)), (200_000, (640, 480)))
RUNS = 7


def ball(n: int, seed: int = 0) -> GaussianCloud:
    """N flat Gaussians on a ball's surface and a few inside, sized so that they cover it."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(n, 3))
    positions /= np.linalg.norm(positions, axis=1, keepdims=True)
    positions[: n // 10] *= rng.uniform(0, 1, (n // 10, 1))
    arrays = (
        positions,
        rng.normal(size=(n, 4)),
        np.log(2.5 / np.sqrt(n)) + rng.normal(0, 0.45, (n, 3)) - [0, 0, 1.5],
        rng.normal(1.5, 2.0, n),
        rng.normal(size=(n, 3)),
        rng.normal(0, 0.05, (n, 3, 15)),
    )
    return GaussianCloud(*(np.ascontiguousarray(array, dtype=np.float32) for array in arrays))


def best_ms(function: Callable[[], Any], runs: int = RUNS) -> float:
    """The shortest of several runs, milliseconds."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return round(1000 * min(times), 1)


def measure(n: int, size: tuple[int, int], threads: int) -> dict[str, Any]:
    """Times of one case, milliseconds."""
    cloud = ball(n)
    camera = orbit((0, 0, 0), 2.8, (30, 20), size)
    rendering = render(cloud, camera, threads=threads)
    target = np.full_like(rendering.colour, 0.5)
    return {
        "gaussians": n,
        "size": list(size),
        "threads": threads,
        "tile_splats": len(rendering.tiles.splats),
        "forward_ms": best_ms(lambda: render(cloud, camera, threads=threads)),
        "backward_ms": best_ms(lambda: render_backward(rendering, target, threads=threads)),
        "ssim_gradient_ms": best_ms(lambda: ssim_with_gradient(rendering.colour, target, threads)),
    }


def main() -> None:
    """Print all cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    as_json = parser.parse_args().json
    first = best_ms(lambda: measure(100, (32, 32), 1), runs=1)
    rows = [measure(n, size, t) for n, size in CASES for t in sorted({1, available_threads()})]
    if as_json:
        print(json.dumps({"first_use_ms": first, "cases": rows}))
        return
    print(f"first use {first / 1000:.1f} s")
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()))


if __name__ == "__main__":
    main()
