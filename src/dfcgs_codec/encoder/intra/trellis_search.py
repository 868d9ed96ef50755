"""The best path through chains of two quantisers that take turns (spec section 9.8).

Dynamic programming over the code's eight states, all chains of a pass at once. A path's cost are its squared
errors, in steps, and its bits, as a Laplace distribution of the expected size has them.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Bool, Float32, Float64, Int64, UInt8
from dfcgs_codec.transform.pieces import pieces
from dfcgs_codec.transform.trellis import CHAIN_LENGTH, num_chains

#: squared steps that a bit is worth
BIT_WORTH = 0.08
#: squared errors where two quantisers take turns, to those of one of them alone
ALTERNATING_ERROR = 0.78
#: errors are no larger than this, in steps; either quantiser has a value within half a step
_MOST_ERROR = 0.85
_LEAST_SIZE = 0.05
#: what all residuals of a pass say of a context, in residuals of its own
_OTHERS = 4
_NUM_STATES = 8


def _machine() -> tuple[Int64, Int64]:
    """States before each state, and the parity that leads from there to it, (2, states).

    A state's bits u, v, w: u is whose turn it is; after a symbol of parity p come u ^ v, w ^ p, u.
    """
    before: list[list[int]] = [[] for _ in range(_NUM_STATES)]
    parity: list[list[int]] = [[] for _ in range(_NUM_STATES)]
    for state in range(_NUM_STATES):
        u, v, w = state >> 2, state >> 1 & 1, state & 1
        for p in (0, 1):
            after = (u ^ v) << 2 | (w ^ p) << 1 | u
            before[after].append(state)
            parity[after].append(p)
    return np.array(before).T, np.array(parity).T


_BEFORE, _PARITY = _machine()
_SECOND = _BEFORE >> 2


def _rates(sizes: Float64) -> tuple[Float64, Float64, Float64]:
    """Bits of 0, of 1, and what each more takes, of symbols of expected magnitudes `sizes`, in steps.

    Either quantiser as often: cells about zero reach to 0.5 and to 0.25, those about one to 1.5 and to 1.
    """
    tails = [np.exp(-reach / sizes) for reach in (0.5, 0.25, 1.5, 1.0)]
    zero = 1.0 - 0.5 * (tails[0] + tails[1])
    one = 0.25 * (tails[0] + tails[1] - tails[2] - tails[3])
    return -np.log2(zero), -np.log2(one), 1.0 / (np.log(2.0) * sizes)


def _candidates(residuals: Float64, contexts: UInt8, sizes: Float64) -> tuple[Float64, Float32]:
    """Magnitudes of symbols (4, rows), and what each costs more than the cheapest.

    By quantiser, then by parity.
    """
    count = len(residuals)
    symbols, excess = np.empty((4, count)), np.empty((4, count), np.float32)
    rates = _rates(np.maximum(sizes, _LEAST_SIZE))
    for part in pieces(count):
        some = contexts[part].astype(np.int64)
        zero, one, more = (bits.take(some) for bits in rates)
        costs = _costs(np.abs(residuals[part]), (BIT_WORTH * zero, one, more), symbols[:, part])
        # sums of differences keep their precision in 32 bits
        costs -= costs.min(axis=0)
        excess[:, part] = costs
    return symbols, excess


def _costs(magnitudes: Float64, rates: tuple[Float64, Float64, Float64], found: Float64) -> Float64:
    """What each candidate costs, (4, rows); `found`, of that shape, takes their magnitudes.

    `rates` (rows,): the worth of a 0, bits of 1, what each more takes.
    """
    nothing, one, more = rates
    nothing += magnitudes**2
    nothing[magnitudes > _MOST_ERROR] = np.inf
    costs, bits = np.empty_like(found), np.empty_like(magnitudes)
    for row, (shift, odd) in enumerate(((0.0, 0), (0.0, 1), (0.5, 0), (0.5, 1))):
        symbols, cost = found[row], costs[row]
        np.add(magnitudes, shift, out=symbols)
        symbols -= odd
        symbols *= 0.5
        np.rint(symbols, out=symbols)
        symbols *= 2.0
        np.maximum(symbols, 0.0, out=symbols)
        symbols += odd
        errors = magnitudes - symbols
        errors += shift
        np.abs(errors, out=errors)
        np.subtract(symbols, 1.0, out=bits)
        bits *= more
        bits += one
        bits *= BIT_WORTH
        np.multiply(errors, errors, out=cost)
        cost += bits
        np.copyto(cost, np.inf, where=errors > _MOST_ERROR)
        if not odd:
            np.copyto(symbols, 0.0, where=nothing <= cost)
            # 0 has no shift
            np.copyto(cost, nothing, where=symbols <= 0.0)
    return costs


def search(residuals: Float64, contexts: UInt8, sizes: Float64) -> Int64:
    """Symbols (rows,) for `residuals` (rows,), in steps; `sizes`: magnitudes expected in each context."""
    count, chains = len(residuals), num_chains(len(residuals))
    magnitudes, costs = _candidates(residuals, contexts, sizes)
    padded = np.zeros((4, CHAIN_LENGTH * chains), np.float32)
    padded[:, :count] = costs
    branches = padded.reshape(4, CHAIN_LENGTH, chains)[2 * _SECOND + _PARITY].transpose(2, 0, 1, 3).copy()
    came = np.empty((CHAIN_LENGTH, _NUM_STATES, chains), np.bool_)
    total = np.full((_NUM_STATES, chains), np.inf, np.float32)
    total[0] = 0.0
    both = np.empty((2, _NUM_STATES, chains), np.float32)
    for step in range(CHAIN_LENGTH):
        # nothing is clipped, but numpy would copy `out` before it raises
        total.take(_BEFORE, axis=0, out=both, mode="clip")
        both += branches[step]
        np.less(both[1], both[0], out=came[step])
        np.minimum(both[0], both[1], out=total)
    choice = _trace(total, came).reshape(-1)[:count]
    chosen = magnitudes[choice, np.arange(count)]
    symbols: Int64 = (np.sign(residuals) * chosen).astype(np.int64)
    return symbols


def _trace(total: Float32, came: Bool) -> Int64:
    """Which of the four candidates each symbol takes, (CHAIN_LENGTH, chains)."""
    length, _, chains = came.shape
    columns = np.arange(chains)
    before = _BEFORE.reshape(-1)
    flat = came.reshape(length, -1).view(np.uint8)
    taken = np.empty((length, chains), np.int64)
    state = total.argmin(axis=0)
    for step in range(length - 1, -1, -1):
        np.multiply(flat[step].take(state * chains + columns), _NUM_STATES, out=taken[step])
        taken[step] += state
        state = before.take(taken[step])
    return (2 * _SECOND + _PARITY).reshape(-1).take(taken)


def context_sizes(residuals: Float64, contexts: UInt8) -> Float64:
    """Mean magnitudes (contexts,) of the residuals of each context; where few are, of all, nearly."""
    magnitudes = np.abs(residuals)
    counts = np.bincount(contexts)
    sums = np.bincount(contexts, magnitudes)
    sizes: Float64 = (sums + _OTHERS * magnitudes.mean()) / (counts + _OTHERS)
    return sizes


def best_path(residuals: Float64, contexts: UInt8) -> Int64:
    """Symbols (rows,) for the `residuals` (rows,) of a pass, in steps, with their contexts."""
    return search(residuals, contexts, context_sizes(residuals, contexts))
