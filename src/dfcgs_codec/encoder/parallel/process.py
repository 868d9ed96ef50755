"""The encoder's end of a worker process, and what goes between: pickles, one after the other, over two pipes.

encoder -> worker   source and plan as pickled bytes, then segments (first frame, end), and None at the end
worker -> encoder   why it cannot load them, or None; then for each segment a CodedSegment or the exception
"""

from __future__ import annotations

import json
import multiprocessing.spawn
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

from dfcgs_codec.encoder.frame.reference import CodedSegment

#: variables that say how many threads numpy's BLAS uses; more than one each would fight over the cores
BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
#: the worker finds what this process can import, and runs nothing of its main module
_BOOT = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from dfcgs_codec.encoder.parallel.worker import main; main(int(sys.argv[2]))"
)
_SECONDS_TO_END = 5


def send(file: BinaryIO, message: Any) -> None:
    """One message; OSError where the other side is gone."""
    pickle.dump(message, file, pickle.HIGHEST_PROTOCOL)
    file.flush()


def receive(file: BinaryIO) -> Any:
    """The next message; EOFError where the other side is gone, be it in the middle of one."""
    try:
        return pickle.load(file)
    except (pickle.UnpicklingError, OSError) as error:
        raise EOFError(str(error)) from error


def interpreter() -> str | None:
    """The Python that workers run in; None in programs that are frozen or have one inside."""
    executable = multiprocessing.spawn.get_executable()
    if getattr(sys, "frozen", False) or not executable:
        return None
    return os.fsdecode(executable)


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Processes that are started meanwhile never see signals of the terminal: masks are inherited.

    Not even before they can ignore them; and an interrupt does not come between a process and its name.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP, signal.SIGQUIT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class WorkerEnded(Exception):
    """The process is gone; `how` says by what."""

    def __init__(self, pid: int, status: int) -> None:
        names = {number.value: number.name for number in signal.Signals}
        self.how = f"by {names.get(-status, -status)}" if status < 0 else f"with exit code {status}"
        self.pid, self.is_killed = pid, status < 0
        super().__init__(f"process {pid} ended {self.how}")


class Worker:
    """A process that codes segments, one at a time."""

    def __init__(self, python: str) -> None:
        environment = dict.fromkeys(BLAS_VARIABLES, "1") | dict(os.environ)
        path = json.dumps([os.path.abspath(entry) for entry in sys.path if isinstance(entry, str)])
        with _signals_held_back():
            self._process = subprocess.Popen(
                [python, "-P", "-c", _BOOT, path, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )

    @property
    def _pipes(self) -> tuple[BinaryIO, BinaryIO]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout  # type: ignore[return-value]

    def ask(self, message: Any) -> Any:
        """The answer to `message`; WorkerEnded where the process is gone."""
        sink, source = self._pipes
        try:
            send(sink, message)
            return receive(source)
        except (OSError, EOFError, ValueError):
            self.close()
            raise WorkerEnded(self._process.pid, self._process.returncode) from None

    def encode(self, segment: tuple[int, int]) -> CodedSegment:
        """Frames `segment[0]` to `segment[1]` - 1; raises what coding them raised."""
        answer = self.ask(segment)
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, CodedSegment)
        return answer

    def dismiss(self) -> None:
        """No more work: the process ends by itself."""
        with suppress(OSError, ValueError):
            send(self._pipes[0], None)

    def kill(self) -> None:
        """End it at once, whatever it is doing."""
        self._process.kill()

    def close(self) -> None:
        """Wait for its end."""
        try:
            self._process.wait(_SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for pipe in self._pipes:
            with suppress(OSError):
                pipe.close()
