"""Pure procedures of the core: what numpy does slowly, bit by bit the same (spec chapters 9 and 14)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.array_types import AnyArray, Int16, Int32, Int64
from dfcgs_codec.core.engine import wants_core
from dfcgs_codec.core.module import MOST_MEMORY, Instance

#: fewer rows are not worth loading the core for
_FEWEST = 1 << 13
_ALIGNMENT = 16
#: `dfcgs_binding` of core/nearness.h
_BINDING = np.dtype([("ranks", "<u2", 4), ("weights", "<u2", 4), ("efforts", "<i2", 5), ("choice", "<u2")])


@dataclass(frozen=True)
class _Result:
    """An array that a procedure fills."""

    dtype: npt.DTypeLike
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        return np.dtype(self.dtype).itemsize * int(np.prod(self.shape))


_Argument = Int32 | _Result | int


def is_worth(count: int) -> bool:
    """Whether the core can run here, and `count` rows are enough for it."""
    return count >= _FEWEST and wants_core()


def _aligned(address: int) -> int:
    return -(-address // _ALIGNMENT) * _ALIGNMENT


def _size(argument: _Argument) -> int:
    return (
        0
        if isinstance(argument, int)
        else argument.nbytes
        if isinstance(argument, np.ndarray)
        else argument.size
    )


def _run(name: str, *arguments: _Argument) -> list[AnyArray]:
    """The results of a procedure that takes an arena, then `arguments`; each call has a memory of its own."""
    instance = Instance()
    place = arena = instance.grow(_ALIGNMENT + sum(_aligned(_size(argument)) for argument in arguments))
    place += _ALIGNMENT
    given, results = [arena], []
    for argument in arguments:
        if isinstance(argument, int):
            given.append(argument)
            continue
        given.append(place)
        if isinstance(argument, _Result):
            results.append((place, argument))
        else:
            instance.put(place, argument.tobytes())
        place += _aligned(_size(argument))
    instance.put(arena, np.array([place, MOST_MEMORY - place, 0, 0], "<u4").tobytes())
    if instance.call(f"dfcgs_{name}", *given):
        raise MemoryError(f"{name} of the core needs more than 4 GiB")
    return [instance.array_at(at, result.dtype, result.shape) for at, result in results]


def _narrow(values: Int64) -> Int32:
    return np.ascontiguousarray(values, "<i4")


def farthest_points(cells: Int64, count: int) -> Int64:
    """See `transform.control_points.farthest_points`."""
    shape = _narrow(cells), len(cells), count
    chosen, found = _run("farthest_points", *shape, _Result("<u4", (count,)), _Result("<u4", (1,)))
    return chosen[: found[0]].astype(np.int64)


def gather(cells: Int64, control: Int64) -> tuple[Int64, Int64]:
    """Ranks and weights (4, N) of points at `cells`; see `transform.control_points.gather_from`."""
    shape = _narrow(cells), len(cells), _narrow(control), len(control)
    (bindings,) = _run("gather", *shape, _Result(_BINDING, (len(cells),)))
    ranks, weights = (bindings[name].T.astype(np.int64, order="C") for name in ("ranks", "weights"))
    return ranks, weights


def distance_weights(positions: Int64) -> Int16:
    """Weights (N, 8) of the neighbours of all rows: the base, which has none, then levels, coarse to fine."""
    (weights,) = _run(
        "distance_weights", _narrow(positions), len(positions), _Result("<i2", (len(positions), 8))
    )
    return weights
