"""Pure procedures of the core: what numpy does slowly, bit by bit the same (spec chapters 9 and 14)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.array_types import AnyArray, Bool, Int16, Int32, Int64
from dfcgs_codec.core.engine import wants_core
from dfcgs_codec.core.module import MOST_MEMORY, Instance

#: fewer rows are not worth loading the core for
_FEWEST = 1 << 13
_ALIGNMENT = 16
#: `dfcgs_binding` of core/nearness.h
_BINDING = np.dtype([("ranks", "<u2", 4), ("weights", "<u2", 4), ("efforts", "<i2", 5), ("choice", "<u2")])


@dataclass(frozen=True)
class _Result:
    """An array that a procedure fills, or changes where it has values at `first`."""

    dtype: npt.DTypeLike
    shape: tuple[int, ...]
    first: AnyArray | None = None

    @property
    def nbytes(self) -> int:
        return np.dtype(self.dtype).itemsize * int(np.prod(self.shape))


#: the argument in place of which a procedure gets an arena
_ARENA = _Result("<u4", (4,))
_Argument = AnyArray | _Result | int


def is_worth(count: int) -> bool:
    """Whether the core can run here, and `count` rows are enough for it."""
    return count >= _FEWEST and wants_core()


def _run(name: str, *arguments: _Argument) -> list[AnyArray]:
    """The results of a procedure, each call of which has a memory of its own."""
    arrays = [argument for argument in arguments if not isinstance(argument, int)]
    sizes = [-(-array.nbytes // _ALIGNMENT) * _ALIGNMENT for array in arrays]
    instance = Instance()
    begin = instance.grow(sum(sizes))
    *places, end = itertools.accumulate(sizes, initial=begin)
    for array, place in zip(arrays, places, strict=True):
        known = array.first if isinstance(array, _Result) else array
        if array is _ARENA:
            known = np.array([end, MOST_MEMORY - end, 0, 0], "<u4")
        if known is not None:
            instance.put(place, known.tobytes())
    left = iter(places)
    if instance.call(f"dfcgs_{name}", *(a if isinstance(a, int) else next(left) for a in arguments)):
        raise MemoryError(f"{name} of the core needs more than 4 GiB")
    return [
        instance.array_at(place, array.dtype, array.shape)
        for array, place in zip(arrays, places, strict=True)
        if isinstance(array, _Result) and array is not _ARENA
    ]


def _narrow(values: Int64) -> Int32:
    return np.ascontiguousarray(values, "<i4")


def farthest_points(cells: Int64, count: int) -> Int64:
    """See `transform.control_points.farthest_points`."""
    shape = _narrow(cells), len(cells), count
    chosen, found = _run("farthest_points", _ARENA, *shape, _Result("<u4", (count,)), _Result("<u4", (1,)))
    return chosen[: found[0]].astype(np.int64)


def gather(cells: Int64, control: Int64) -> tuple[Int64, Int64]:
    """Ranks and weights (4, N) of points at `cells`; see `transform.control_points.gather_from`."""
    shape = _narrow(cells), len(cells), _narrow(control), len(control)
    (bindings,) = _run("gather", _ARENA, *shape, _Result(_BINDING, (len(cells),)))
    ranks, weights = (bindings[name].T.astype(np.int64, order="C") for name in ("ranks", "weights"))
    return ranks, weights


def distance_weights(positions: Int64) -> Int16:
    """Weights (N, 8) of the neighbours of all rows: the base, which has none, then levels, coarse to fine."""
    count = len(positions)
    (weights,) = _run("distance_weights", _ARENA, _narrow(positions), count, _Result("<i2", (count, 8)))
    return weights


def turned(quaternions: Int64, vectors: Int64) -> Int64:
    """See `codec.motion.compensation.turned`."""
    result = _Result("<i4", quaternions.shape, _narrow(quaternions))
    (rotations,) = _run("turn_all", _narrow(vectors), len(vectors), result)
    return rotations.astype(np.int64)


def expect_turns(axes: Int64, needles: Bool, weights: Int32, level: int) -> tuple[Int64, Int64, Int64]:
    """Frames (rows, 4) of level number `level`, and half squares of the angles of tilts and spins (rows,).

    `axes` (N, 3, 3) and `needles` (N,) are those of all Gaussians, `weights` (8, rows) of the level; see
    `transform.pole.predict_poles`.
    """
    rows = weights.shape[1]
    shape = _narrow(axes), needles.astype(np.uint8), len(axes), level, np.ascontiguousarray(weights.T, "<i2")
    frames, tilts, spins = _run(
        "expect_turns", *shape, _Result("<i4", (rows, 4)), _Result("<i8", (rows,)), _Result("<i8", (rows,))
    )
    return frames.astype(np.int64), tilts, spins
