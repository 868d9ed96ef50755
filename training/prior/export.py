"""Trained networks as integers, and the file of the model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, Integers, UInt8
from dfcgs_codec.model.context_model import (
    ACTIVATION_LIMIT,
    INPUT_LIMIT,
    NUM_CLASSES,
    NUM_FLAG_CLASSES,
    ClassNetwork,
)
from dfcgs_codec.model.weights_file import ENDING, digest_of, write_arrays
from training.prior.nets import (
    CLASSES_PER_LOGIT,
    CLASSES_PER_OCTAVE,
    EVEN_CLASS,
    HIDDEN_LIMIT,
    UNIT_CLASS,
    ClassNet,
)

Arrays = dict[str, Integers]
_EXACT = 1 << 24
_LARGEST_WEIGHT = (1 << 15) - 1
_MAX_SHIFT = 23


def _integers(weight: Float64, bias: Float64, input_limit: int) -> tuple[Float64, Float64, int]:
    """Weights and bias times the largest power of two that keeps sums exact, and its logarithm."""
    for shift in range(_MAX_SHIFT, -1, -1):
        scaled, offset = np.rint(weight * 2.0**shift), np.rint(bias * 2.0**shift)
        sums = np.abs(scaled).sum(axis=1) * input_limit + np.abs(offset)
        if np.abs(scaled).max() <= _LARGEST_WEIGHT and sums.max() < _EXACT:
            return scaled, offset, shift
    raise ValueError("weights are too large for exact sums")


def network_arrays(net: ClassNet, name: str) -> Arrays:
    """The integer layers of a network; its output is a class."""
    is_flags = name == "flags"
    slope, middle = (CLASSES_PER_LOGIT, EVEN_CLASS) if is_flags else (CLASSES_PER_OCTAVE, UNIT_CLASS)
    classes = NUM_FLAG_CLASSES if is_flags else NUM_CLASSES
    arrays: Arrays = {}
    hidden = ACTIVATION_LIMIT / HIDDEN_LIMIT
    input_scale, input_limit = 1.0, INPUT_LIMIT
    for index, layer in enumerate(net.layers):
        weight = layer.weight.detach().numpy().astype(np.float64)
        bias = layer.bias.detach().numpy().astype(np.float64)
        if index == 0:
            weight = weight * net.mask.numpy()
        is_last = index == len(net.layers) - 1
        if is_last:
            weight, bias = weight * slope, bias * slope + middle + 0.5
        out_scale = 1.0 if is_last else hidden
        scaled, offset, shift = _integers(weight * out_scale / input_scale, bias * out_scale, input_limit)
        arrays[f"{name}.{index}.weight"] = scaled.astype(np.int16)
        arrays[f"{name}.{index}.bias"] = offset.astype(np.int32)
        arrays[f"{name}.{index}.scale"] = np.array([shift, classes - 1 if is_last else ACTIVATION_LIMIT])
        input_scale, input_limit = hidden, ACTIVATION_LIMIT
    return arrays


def integer_classes(arrays: Arrays, name: str, inputs: UInt8) -> Int64:
    """Classes (rows,) by the runtime's network."""
    classes = NUM_FLAG_CLASSES if name == "flags" else NUM_CLASSES
    network = ClassNetwork.of(arrays, name, (inputs.shape[1], 0), classes)
    return network.classes(network.prepare(inputs), inputs[:, :0])


def write_model(arrays: Arrays, target: Path, about: dict[str, Any]) -> Path:
    """Write `target`.weights and `target`.json; the path of the first."""
    target.parent.mkdir(parents=True, exist_ok=True)
    path = target.with_suffix(ENDING)
    write_arrays(path, arrays)
    found = {"model_id": target.name, "sha256": digest_of(arrays).hex(), **about}
    shapes = {name: list(array.shape) for name, array in sorted(arrays.items())}
    target.with_suffix(".json").write_text(json.dumps(found | {"shapes": shapes}, indent=1) + "\n")
    return path
