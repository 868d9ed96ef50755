"""Two quantisers that take turns: which one a symbol is of follows from symbols before it (spec section 9.8).

Cells of both are as wide as the step, those of the second lie half a step beside those of the first, and both
have zero. Parities of the symbols before say whose turn it is, so that a path through a chain of symbols has
twice as many values to choose from at nearly the cost of one quantiser's: trellis-coded quantisation with
Ungerboeck's code of eight states.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Int8, Int64

#: symbols of a chain, at most
CHAIN_LENGTH = 128
#: passes of fewer symbols have the first quantiser alone
FEWEST_SYMBOLS = 512
#: what the code's recurrence repeats after
_PERIOD = 7
_LENGTH = -(-CHAIN_LENGTH // _PERIOD) * _PERIOD


def num_chains(count: int) -> int:
    """Chains of `count` symbols: symbol i is number i // num_chains of chain i % num_chains."""
    return -(-count // CHAIN_LENGTH)


def second_quantisers(symbols: Int64) -> Int8:
    """1 for each of `symbols` (rows,) that is of the second quantiser, else 0.

    In each chain, a[t] = a[t - 1] ^ a[t - 3] ^ p[t - 2], with parities p, and 0 before the first.
    """
    count, chains = len(symbols), num_chains(len(symbols))
    odd = np.zeros((6 + _LENGTH, chains), np.int8)
    odd[6:].reshape(-1)[:count] = symbols & 1
    # 1 / (1 + D + D**3) = (1 + D + D**2 + D**4) / (1 + D**7) over GF(2)
    sums = odd[4:-2] ^ odd[3:-3] ^ odd[2:-4] ^ odd[:-6]
    second = np.bitwise_xor.accumulate(sums.reshape(-1, _PERIOD, chains), axis=0)
    result: Int8 = second.reshape(-1)[:count]
    return result


def takes_turns(count: int) -> bool:
    """Whether a pass has so many symbols that two quantisers take turns in it, where they may."""
    return count >= FEWEST_SYMBOLS


def step_values(symbols: Int64, steps: Int64, *, alternating: bool) -> Int64:
    """What the symbols of a pass (rows,) mean, with `steps` (rows,); products shall not leave 63 bits."""
    if not (alternating and takes_turns(len(symbols))):
        return symbols * steps
    shifts = np.sign(symbols).astype(np.int64) * second_quantisers(symbols)
    values: Int64 = (2 * symbols - shifts) * steps >> 1
    return values
