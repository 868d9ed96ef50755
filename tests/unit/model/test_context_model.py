from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfcgs_codec.model.context_model import (
    ACTIVATION_LIMIT,
    INPUT_LIMIT,
    NUM_CELLS,
    NUM_CLASSES,
    NUM_COLUMN_INPUTS,
    NUM_COMMON_INPUTS,
    NUM_FLAG_CLASSES,
    NUM_FRACTIONS,
    NUM_KINDS,
    NUM_LOW_CLASSES,
    ClassNetwork,
    ContextModel,
    cells_of,
)
from dfcgs_codec.model.layers import LayerError
from dfcgs_codec.model.registry import DEFAULT_PRIOR, installed
from dfcgs_codec.model.weights_file import Arrays
from tests.context_models import WIDTHS, random_arrays


def classes_of(arrays: Arrays, name: str, inputs: np.ndarray) -> list[int]:
    """Section 17.1 in Python's integers."""
    found = []
    for values in inputs.tolist():
        index = 0
        while f"{name}.{index}.weight" in arrays:
            weight, bias = arrays[f"{name}.{index}.weight"].tolist(), arrays[f"{name}.{index}.bias"].tolist()
            shift, limit = arrays[f"{name}.{index}.scale"].tolist()
            sums = [
                b + sum(w * v for w, v in zip(r, values, strict=True))
                for r, b in zip(weight, bias, strict=True)
            ]
            values = [min(max(s >> shift, 0), limit) for s in sums]
            index += 1
        found.append(values[0])
    return found


def extreme_inputs(count: int, width: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    rows = rng.integers(0, INPUT_LIMIT + 1, (count, width))
    rows[0], rows[1] = 0, INPUT_LIMIT
    rows[2, ::2] = INPUT_LIMIT
    return rows.astype(np.uint8)


@pytest.mark.parametrize("name", list(WIDTHS))
@pytest.mark.parametrize("source", ["random", "package"])
def test_networks_are_those_of_the_text(name: str, source: str) -> None:
    if source == "random":
        arrays: Arrays = random_arrays(5)
    else:
        from dfcgs_codec.model import registry
        from dfcgs_codec.model.weights_file import read_arrays

        arrays = read_arrays(registry._WEIGHTS / f"{DEFAULT_PRIOR}.weights")
    width, classes = WIDTHS[name]
    inputs = extreme_inputs(60, width)
    for common in (0, 3, width):
        network = ClassNetwork.of(arrays, name, (common, width - common), classes)
        found = network.classes(network.prepare(inputs[:, :common]), inputs[:, common:])
        assert found.tolist() == classes_of(arrays, name, inputs)
        # in any batches
        apart = [
            network.classes(network.prepare(row[None, :common]), row[None, common:])[0] for row in inputs
        ]
        assert apart == found.tolist()


def test_every_class_kind_and_fraction_has_a_cell() -> None:
    grid = np.meshgrid(range(NUM_KINDS), range(NUM_FRACTIONS), range(NUM_CLASSES), indexing="ij")
    kinds, fractions, classes = (part.ravel() for part in grid)
    cells = cells_of(classes, kinds, fractions)
    assert sorted(set(cells.tolist())) == list(range(NUM_CELLS))
    low = classes < NUM_LOW_CLASSES
    assert len(set(cells[low].tolist())) == low.sum()
    assert np.array_equal(cells[~low], NUM_CELLS - NUM_CLASSES + classes[~low])


def broken(name: str, array: object) -> dict[str, np.ndarray]:
    arrays = random_arrays()
    if array is None:
        del arrays[name]
    else:
        arrays[name] = array  # type: ignore[assignment]
    return arrays


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("flags.0.bias", None),
        ("columns.tables", None),
        ("control.frequencies", None),
        ("control.weights", None),
        ("flags.0.weight", np.zeros((12, 5), np.int16)),
        ("columns.0.weight", np.full((12, NUM_COMMON_INPUTS + NUM_COLUMN_INPUTS), 20000, np.int16)),
        ("columns.1.scale", np.array([10, NUM_CLASSES], np.int64)),
        ("columns.0.scale", np.array([5, ACTIVATION_LIMIT + 1], np.int64)),
        ("columns.0.scale", np.array([24, ACTIVATION_LIMIT], np.int64)),
        ("columns.tables", np.full(NUM_CELLS, 480, np.int16)),
        ("columns.tables", np.full(NUM_CELLS, -10, np.int16)),
        ("control.tables", np.zeros(3, np.int16)),
        ("control.frequencies", np.full((9, 31), 1 << 10, np.int32)),
        ("flags.frequencies", np.full((NUM_FLAG_CLASSES, 3), 1, np.int32)),
        ("densities.frequencies", np.zeros((16, 4), np.int32)),
        ("magnitudes.tables", np.full(8, -1, np.int16)),
        ("control.weights", np.full((6, 8), 5000, np.int16)),
    ],
)
def test_what_is_no_prior_is_refused(name: str, array: object) -> None:
    with pytest.raises(LayerError):
        ContextModel.of_arrays("broken", broken(name, array))


def test_sums_of_the_package_s_prior_are_exact() -> None:
    model = installed(DEFAULT_PRIOR)
    assert isinstance(model, ContextModel)
    for part in (model.flags, model.columns, model.control):
        limit = INPUT_LIMIT
        for layer in part.network.layers:  # type: ignore[union-attr]
            sums = np.abs(layer.weight.astype(np.float64)).sum(axis=1) * limit + np.abs(layer.bias)
            assert sums.max() < 1 << 24
            limit = layer.limit


@given(st.integers(0, 1 << 40))
def test_logarithms_are_those_of_the_text(value: int) -> None:
    from dfcgs_codec.codec.columns.magnitudes import log_of

    limited = min(value, (1 << 24) - 1)
    bits = limited.bit_length()
    expected = 8 * bits + ((limited << 3) >> (bits - 1)) - 8 if limited else 0
    assert int(log_of(np.array([value]))[0]) == expected
