"""Layers of integers in float64: equal to int64 arithmetic, in any batch, with any number of threads."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

from dfcgs_codec.array_types import Int16, Int64, Integers
from dfcgs_codec.model.layers import ACTIVATION_LIMIT, OUTPUT_LIMIT, Layer, LayerError, Network
from tests.helpers import ROOT

Arrays = tuple[Int16, Int64, Int64]


def arrays(rng: np.random.Generator, widths: tuple[int, ...], *, extreme: bool = False) -> list[Arrays]:
    found = []
    for index, (inputs, outputs) in enumerate(itertools.pairwise(widths)):
        last = index == len(widths) - 2
        if extreme:
            weight = rng.choice([-32768, 32767], (outputs, inputs))
        else:
            weight = rng.integers(-300, 301, (outputs, inputs))
        bias = rng.integers(-(1 << 20), 1 << 20, outputs)
        limit = OUTPUT_LIMIT if last else ACTIVATION_LIMIT
        found.append((weight.astype(np.int16), bias, np.array([9, limit, not last], np.int64)))
    return found


def network(layers: list[Arrays]) -> Network:
    return Network(tuple(Layer.of(*layer) for layer in layers))


def in_integers(layers: list[Arrays], inputs: Int64) -> Int64:
    """Spec section 16.1, word by word."""
    values = np.clip(inputs, -ACTIVATION_LIMIT, ACTIVATION_LIMIT)
    for weight, bias, (shift, limit, leaky) in layers:
        values = np.clip((values @ weight.T.astype(np.int64) + bias) >> shift, -limit, limit)
        if leaky:
            values = np.where(values < 0, values >> 7, values)
    return values


@pytest.mark.parametrize("extreme", [False, True])
def test_layers_equal_int64_arithmetic(extreme: bool) -> None:
    rng = np.random.default_rng(1)
    layers = arrays(rng, (56, 64, 64, 16), extreme=extreme)
    high = 1 << 17 if extreme else 2000
    inputs = rng.integers(-high, high, (9000, 56))
    outputs = network(layers)(inputs)
    assert outputs.dtype == np.int64
    np.testing.assert_array_equal(outputs, in_integers(layers, inputs))
    assert len(np.unique(outputs)) > 100


def test_a_batch_of_one_row_is_that_row_of_all() -> None:
    rng = np.random.default_rng(2)
    net = network(arrays(rng, (24, 128, 128, 16)))
    inputs = rng.integers(-4000, 4000, (300, 24))
    together = net(inputs)
    for row in (0, 7, 299):
        np.testing.assert_array_equal(net(inputs[row : row + 1])[0], together[row])
    np.testing.assert_array_equal(np.concatenate([net(inputs[:7]), net(inputs[7:])]), together)
    assert net(inputs[:0]).shape == (0, 16)


_HASH = """
import hashlib
import numpy as np
from tests.unit.model.test_integer_layers import arrays, network
rng = np.random.default_rng(3)
net = network(arrays(rng, (56, 128, 128, 45), extreme=True))
print(hashlib.sha256(net(rng.integers(-40000, 40000, (10000, 56))).tobytes()).hexdigest())
"""


def test_threads_and_kernels_change_nothing() -> None:
    found = set()
    for threads, kernel in (("1", ""), ("2", ""), ("1", "Prescott"), ("2", "Nehalem")):
        environment = os.environ | {"OPENBLAS_NUM_THREADS": threads, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}
        if kernel:
            environment["OPENBLAS_CORETYPE"] = kernel
        done = subprocess.run(
            [sys.executable, "-c", _HASH],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        found.add(done.stdout.strip())
    assert len(found) == 1


def test_sums_that_could_be_inexact_are_refused() -> None:
    weight = np.full((1, 8), 32767, np.int16)
    scale = np.array([0, ACTIVATION_LIMIT, 0], np.int64)
    fine = Layer.of(weight, np.array([(1 << 53) - 8 * 32767 * 32767 - 1]), scale)
    Network((fine,))
    with pytest.raises(LayerError, match="2\\*\\*53"):
        Network((Layer.of(weight, np.array([(1 << 53) - 8 * 32767 * 32767]), scale),))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"weight": np.zeros((2, 3), np.int32)}, "do not fit"),
        ({"bias": np.zeros(3, np.int64)}, "do not fit"),
        ({"scale": np.array([-1, 5, 0])}, "shift -1"),
        ({"scale": np.array([1, 0, 0])}, "limit 0"),
        ({"scale": np.array([1, OUTPUT_LIMIT + 1, 0])}, "limit"),
        ({"scale": np.array([1, 5, 2])}, "leaky 2"),
    ],
)
def test_arrays_that_make_no_layer(changes: dict[str, Integers], words: str) -> None:
    parts = {
        "weight": np.zeros((2, 3), np.int16),
        "bias": np.zeros(2, np.int64),
        "scale": np.array([1, 5, 0]),
    }
    with pytest.raises(LayerError, match=words):
        Layer.of(**(parts | changes))


def test_layers_that_do_not_follow_each_other() -> None:
    rng = np.random.default_rng(4)
    first, second = arrays(rng, (4, 5, 2))[0], arrays(rng, (6, 3))[0]
    with pytest.raises(LayerError, match="takes 6 values and is given 5"):
        network([first, second])
    wide = (*first[:2], np.array([9, OUTPUT_LIMIT, 1], np.int64))
    with pytest.raises(LayerError, match="lets 4194304 pass"):
        network([wide, arrays(rng, (5, 3))[0]])
