"""Segments coded by several processes.

Each is started anew and runs nothing of this program's main module, so that this works in scripts without
a guard, in notebooks, threads and processes of a pool.
"""

from __future__ import annotations

import pickle
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from queue import SimpleQueue
from typing import Any

from dfcgs_codec.encoder.frame.reference import CodedSegment
from dfcgs_codec.encoder.parallel.process import Worker, WorkerEnded, interpreter
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.errors import InputError
from dfcgs_codec.sequence import FrameSource

#: segments in flight per process, so that a fast process never waits and memory stays bounded
_SEGMENTS_PER_JOB = 2
#: what ends a worker may be meant for all processes of the run: its signal comes first then
_SECONDS_FOR_A_SIGNAL = 0.2


class NoWorkers(Exception):
    """No other process can code these frames; the message says why. Nothing was coded so far."""


class _Lost(Exception):
    def __init__(self, segment: tuple[int, int], ended: WorkerEnded) -> None:
        self.segment, self.ended = segment, ended
        super().__init__(str(ended))


def _start(jobs: int) -> list[Worker]:
    python = interpreter()
    if python is None:
        raise NoWorkers("this program has no Python interpreter beside it to start processes with")
    workers: list[Worker] = []
    try:
        for _ in range(jobs):
            workers.append(Worker(python))
    except OSError as error:
        if not workers:
            raise NoWorkers(f"no process could be started ({error.strerror})") from None
    except BaseException:
        _kill(workers)
        raise
    return workers


def _kill(workers: list[Worker]) -> None:
    for worker in workers:
        worker.kill()


def _set_up(
    threads: ThreadPoolExecutor, workers: list[Worker], data: bytes, segments: list[tuple[int, int]]
) -> None:
    """Each gets the setup; where one is killed, the frames are those that would have been its first."""

    def ask(worker: Worker, segment: tuple[int, int]) -> Any:
        try:
            return worker.ask(data)
        except WorkerEnded as error:
            if error.is_killed:
                raise _Lost(segment, error) from None
            raise NoWorkers(f"processes end as they start ({error})") from None

    for answer in list(threads.map(ask, workers, segments)):
        if answer is not None:
            raise NoWorkers(
                f"other processes cannot load what reads the frames ({answer}); its class must be in "
                "a module that they can import"
            )


def _pickled(source: FrameSource, plan: SequencePlan) -> bytes:
    try:
        return pickle.dumps((source, plan), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise NoWorkers(f"what reads the frames cannot be sent to other processes ({reason})") from None


def _first_result(waiting: deque[Future[CodedSegment]]) -> CodedSegment:
    while not waiting[0].done():
        done, _ = wait([future for future in waiting if not future.done()], return_when=FIRST_COMPLETED)
        for future in done:
            if future.exception():
                future.result()
    return waiting.popleft().result()


def _in_order(
    threads: ThreadPoolExecutor, workers: list[Worker], segments: list[tuple[int, int]]
) -> Iterator[CodedSegment]:
    idle: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def work(segment: tuple[int, int]) -> CodedSegment:
        worker = idle.get()
        try:
            return worker.encode(segment)
        except WorkerEnded as error:
            raise _Lost(segment, error) from None
        finally:
            idle.put(worker)

    waiting: deque[Future[CodedSegment]] = deque()
    for segment in segments:
        waiting.append(threads.submit(work, segment))
        if len(waiting) >= _SEGMENTS_PER_JOB * len(workers):
            yield _first_result(waiting)
    while waiting:
        yield _first_result(waiting)


def _message(lost: _Lost, numbers: list[int]) -> str:
    start, stop = lost.segment
    why = ", most likely for want of memory" if lost.ended.how.endswith("SIGKILL") else ""
    return (
        f"the worker process of frames {numbers[start]} to {numbers[stop - 1]} (process {lost.ended.pid}) "
        f"was ended {lost.ended.how}{why}; use fewer --jobs, or run it again"
    )


def code_in_parallel(
    source: FrameSource, plan: SequencePlan, segments: list[tuple[int, int]]
) -> Iterator[CodedSegment]:
    """Segments in order, coded by `plan.options.jobs` processes; the bytes are those of one process.

    On an error or an interrupt the processes are ended at once. NoWorkers where there cannot be any.
    """
    data = _pickled(source, plan)
    workers = _start(min(plan.options.jobs, len(segments)))
    try:
        with ThreadPoolExecutor(len(workers)) as threads:
            try:
                _set_up(threads, workers, data, segments)
                del data
                yield from _in_order(threads, workers, segments)
            except BaseException:
                _kill(workers)
                threads.shutdown(wait=False, cancel_futures=True)
                raise
        for worker in workers:
            worker.dismiss()
    except _Lost as error:
        time.sleep(_SECONDS_FOR_A_SIGNAL)
        raise InputError(_message(error, source.numbers)) from None
    finally:
        for worker in workers:
            worker.close()
