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
class _Array:
    """An array for the core to read, of `values`, or to fill; a result comes back with the type `result`."""

    dtype: npt.DTypeLike
    shape: tuple[int, ...]
    values: AnyArray | None = None
    result: npt.DTypeLike | None = None

    @property
    def room(self) -> int:
        """Bytes up to what lies behind it."""
        return -(-np.dtype(self.dtype).itemsize * int(np.prod(self.shape)) // _ALIGNMENT) * _ALIGNMENT


#: the argument in place of which a procedure gets an arena
_ARENA = _Array("<u4", (4,))
_Argument = _Array | int


def _given(values: AnyArray, dtype: npt.DTypeLike = "<i4") -> _Array:
    return _Array(dtype, values.shape, values)


def is_worth(count: int) -> bool:
    """Whether the core can run here, and `count` rows are enough for it."""
    return count >= _FEWEST and wants_core()


def _run(name: str, *arguments: _Argument) -> list[AnyArray]:
    """The results of a procedure, each call of which has a memory of its own."""
    arrays = [argument for argument in arguments if isinstance(argument, _Array)]
    instance = Instance()
    begin = instance.grow(sum(array.room for array in arrays))
    *places, end = itertools.accumulate((array.room for array in arrays), initial=begin)
    views = [instance.view_at(place, a.dtype, a.shape) for a, place in zip(arrays, places, strict=True)]
    for array, view in zip(arrays, views, strict=True):
        if array is _ARENA:
            view[:2] = end, MOST_MEMORY - end
        elif array.values is not None:
            view[...] = array.values
    left = iter(places)
    if instance.call(f"dfcgs_{name}", *(a if isinstance(a, int) else next(left) for a in arguments)):
        raise MemoryError(f"{name} of the core needs more than 4 GiB")
    return [
        np.array(instance.view_at(place, a.dtype, a.shape), a.result)
        for a, place in zip(arrays, places, strict=True)
        if a.result is not None
    ]


def farthest_points(cells: Int64, count: int) -> Int64:
    """See `transform.control_points.farthest_points`."""
    results = _Array("<u4", (count,), result=np.int64), _Array("<u4", (1,), result=np.int64)
    chosen, found = _run("farthest_points", _ARENA, _given(cells), len(cells), count, *results)
    return chosen[: int(found[0])]


def gather(cells: Int64, control: Int64) -> tuple[Int64, Int64]:
    """Ranks and weights (4, N) of points at `cells`; see `transform.control_points.gather_from`."""
    result = _Array(_BINDING, (len(cells),), result=_BINDING)
    (bindings,) = _run("gather", _ARENA, _given(cells), len(cells), _given(control), len(control), result)
    ranks, weights = (bindings[name].T.astype(np.int64, order="C") for name in ("ranks", "weights"))
    return ranks, weights


def distance_weights(positions: Int64) -> Int16:
    """Weights (N, 8) of the neighbours of all rows: the base, which has none, then levels, coarse to fine."""
    count = len(positions)
    result = _Array("<i2", (count, 8), result=np.int16)
    return _run("distance_weights", _ARENA, _given(positions), count, result)[0]


def turned(quaternions: Int64, vectors: Int64) -> Int64:
    """See `codec.motion.compensation.turned`."""
    result = _Array("<i4", quaternions.shape, quaternions, np.int64)
    return _run("turn_all", _given(vectors), len(vectors), result)[0]


def expect_turns(axes: Int64, needles: Bool, weights: Int32, level: int) -> tuple[Int64, Int64, Int64]:
    """Frames (rows, 4) of level number `level`, and half squares of the angles of tilts and spins (rows,).

    `axes` (N, 3, 3) and `needles` (N,) are those of all Gaussians, `weights` (8, rows) of the level; see
    `transform.pole.predict_poles`.
    """
    shape = _given(axes), _given(needles, "u1"), len(axes), level, _given(weights.T, "<i2")
    rows = weights.shape[1]
    angles = _Array("<i8", (rows,), result=np.int64)
    frames, tilts, spins = _run(
        "expect_turns", *shape, _Array("<i4", (rows, 4), result=np.int64), angles, angles
    )
    return frames, tilts, spins
