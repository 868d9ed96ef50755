"""How the compiled kernels are built and run: numba without its own threads, Python threads over ranges.

Every kernel that runs in parallel has the form `kernel(first, stop, ...)` and writes only what belongs to the
items of its range, so the result does not depend on the number of threads or on their timing.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from numba import njit

# "contract" allows fused multiply-add: results are equal on one machine, not to the bit across CPU types
_compile = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "nsz"})

_SOURCES = tuple(
    (path.name, path.stat().st_mtime, path.stat().st_size)
    for path in sorted(Path(__file__).parent.glob("*.py"))
)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function at its first call, and keep the machine code in `__pycache__`.

    numba's cache follows changes of the function's own file only; a kernel has the constants and the kernels
    of other files compiled into it, so here a change of any file of this package counts.
    """
    compiled = _compile(function)
    compiled._cache._cache_file._source_stamp = _SOURCES
    return compiled


def available_threads() -> int:
    """The number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_ranges(
    function: Callable[..., None], count: int, grain: int, threads: int | None, *arguments: Any
) -> None:
    """Call `function(first, stop, *arguments)` over [0, count) in pieces of `grain` items.

    threads: None for all cores. The pool lives for one call: a pool that is kept does not survive a fork.
    """
    workers = min(threads or available_threads(), -(-count // grain))
    if workers <= 1:
        function(0, count, *arguments)
        return
    with ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(function, first, min(first + grain, count), *arguments)
            for first in range(0, count, grain)
        ]
        for job in jobs:
            job.result()
