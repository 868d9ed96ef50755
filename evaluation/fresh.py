"""Commands in fresh processes, timed, with the memory of all their processes together."""

from __future__ import annotations

import resource
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path

_POLL_SECONDS = 0.05


@dataclass(frozen=True)
class Run:
    """seconds: wall clock from start to end of the process. peak_mib: largest sum of resident memory seen."""

    exit_code: int
    seconds: float
    peak_mib: float
    message: str
    output: str = ""


def _resident(pid: int) -> int:
    """Bytes resident of a process and its descendants; 0 for one that has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except (OSError, IndexError):
        return 0
    return pages * resource.getpagesize() + sum(_resident(int(child)) for child in children)


def run_fresh(command: list[str]) -> Run:
    """Run a command to its end; `message` is the last line it printed on stderr, `output` all of stdout."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    peak, ended = 0, threading.Event()

    def watch() -> None:
        nonlocal peak
        while not ended.wait(_POLL_SECONDS):
            peak = max(peak, _resident(process.pid))

    watcher = threading.Thread(target=watch)
    watcher.start()
    output, messages = process.communicate()
    errors = messages.strip().splitlines()
    seconds = time.perf_counter() - start
    ended.set()
    watcher.join()
    return Run(process.returncode, seconds, round(peak / 2**20, 1), errors[-1] if errors else "", output)
