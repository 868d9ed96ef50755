"""Segments coded by several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from types import FrameType

from dfcgs_codec.encoder.plan import SequencePlan
from dfcgs_codec.encoder.segment import CodedSegment, SegmentEncoder
from dfcgs_codec.errors import InputError
from dfcgs_codec.sequence import FrameSource

#: segments in flight per process, so that a fast process never waits and memory stays bounded
_SEGMENTS_PER_JOB = 2
_BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_worker: SegmentEncoder | None = None


def _start_worker(source: FrameSource, plan: SequencePlan) -> None:
    global _worker
    # an interrupt is the parent's to handle; it ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker = SegmentEncoder(source, plan)


def _work(segment: tuple[int, int]) -> CodedSegment:
    assert _worker is not None
    return _worker.encode(*segment)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Processes started meanwhile use one BLAS thread each: more would fight over the cores."""
    unset = [name for name in _BLAS_VARIABLES if name not in os.environ]
    os.environ.update(dict.fromkeys(unset, "1"))
    try:
        yield
    finally:
        for name in unset:
            os.environ.pop(name, None)


@contextmanager
def _interrupt_later() -> Iterator[None]:
    """Hold an interrupt back: a pool that is interrupted while it starts cannot be shut down.

    Processes that are started meanwhile never see one, where signals can be masked: masks are inherited.
    """
    if hasattr(signal, "pthread_sigmask"):
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return
    previous = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or previous is None:
        yield
        return
    held: list[FrameType | None] = []
    signal.signal(signal.SIGINT, lambda _, frame: held.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
    if held:
        signal.raise_signal(signal.SIGINT)


def _submit(pool: ProcessPoolExecutor, segment: tuple[int, int]) -> Future[CodedSegment]:
    # the first submissions start the processes
    with _interrupt_later():
        return pool.submit(_work, segment)


def _in_order(
    pool: ProcessPoolExecutor, segments: list[tuple[int, int]], in_flight: int
) -> Iterator[CodedSegment]:
    waiting: deque[Future[CodedSegment]] = deque()
    for segment in segments:
        waiting.append(_submit(pool, segment))
        if len(waiting) >= in_flight:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def code_in_parallel(
    source: FrameSource, plan: SequencePlan, segments: list[tuple[int, int]]
) -> Iterator[CodedSegment]:
    """Segments in order, coded by `plan.options.jobs` processes; the bytes are those of one process.

    On an error or an interrupt the processes are ended at once.
    """
    jobs = min(plan.options.jobs, len(segments))
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with _one_blas_thread(), ProcessPoolExecutor(jobs, context, _start_worker, (source, plan)) as pool:
        try:
            yield from _in_order(pool, segments, _SEGMENTS_PER_JOB * jobs)
        except BrokenProcessPool:
            raise InputError(
                "a worker process was ended by the system, most likely for want of memory; use fewer --jobs"
            ) from None
        except BaseException:
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
