"""What goes between the encoder and its worker processes: pickles, one after the other, over two pipes.

encoder -> worker   the setup as pickled bytes, then segments (first frame, end), and None at the end
worker -> encoder   Ready or Refused, then for each segment a CodedSegment or the exception
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Any, BinaryIO

from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.sequence import FrameSource

#: variables that say how many threads numpy's BLAS uses; more than one each would fight over the cores
BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Setup:
    """All that a worker needs to code any segment."""

    source: FrameSource
    plan: SequencePlan


@dataclass(frozen=True)
class Ready:
    """The worker has its setup."""


@dataclass(frozen=True)
class Refused:
    """The worker cannot unpickle its setup."""

    reason: str


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


def portable(error: BaseException) -> BaseException:
    """`error` as one that can be pickled and unpickled: itself, if possible."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
