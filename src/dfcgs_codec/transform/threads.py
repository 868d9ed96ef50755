"""Two things at a time: numpy lets other threads run while it works on large arrays.

What is computed never depends on it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from typing import TypeVar

T = TypeVar("T")

_MOST_THREADS = 2


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(min(_MOST_THREADS, os.cpu_count() or 1), "dfcgs")


def beside(task: Callable[[], T]) -> Future[T]:
    """Run `task` while the caller goes on. It must not call `beside` itself, and wait for that."""
    return _pool().submit(task)
