"""Float networks -> the two files of an integer model: `<id>.weights` and `<id>.json`."""

from __future__ import annotations

import json
import math
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.array_types import AnyArray, Float64, Int16, Int32
from dfcgs_codec.entropy.tables import frequencies_from_cdf
from dfcgs_codec.errors import InputError
from dfcgs_codec.model.weights_file import ENDING, digest_of, file_of
from training.paper.coding import closed_loop, frame_prior
from training.paper.data import Data
from training.paper.factorised import FactorisedModel
from training.paper.integers import EXACT, HYPER_REACH, IntegerLayer
from training.paper.nets import ACTIVATION_LIMIT, GRID_BITS, GRID_LIMIT, LEAKY_SHIFT, PARTS, Net, PaperModel
from training.paper.train import Run

Arrays = dict[str, AnyArray]
#: hidden activations seen on training data are at most 1 / this of their limit
HEAD_ROOM = 2.0
NUM_CALIBRATION_GOFS = 24
#: of weights and of hidden activations, sign included
FULL_BITS = (16, 16)
_MAX_WEIGHT_FRACTION = 24
_CDF_BITS = 32


def hidden_ranges(
    model: PaperModel, data: Data, num_gofs: int = NUM_CALIBRATION_GOFS
) -> dict[str, list[float]]:
    """Largest magnitude after LeakyReLU behind each layer of each network, on training data."""
    ranges = {name: [0.0] * len(net.layers) for name, net in model.nets.items()}
    hooks = []

    def watch(name: str, index: int) -> Any:
        def note(_module: object, _inputs: object, output: Tensor) -> None:
            largest = max(float(output.max()), -float(output.min()) * 2.0**-LEAKY_SHIFT)
            ranges[name][index] = max(ranges[name][index], largest)

        return note

    for name, net in model.nets.items():
        hooks += [layer.register_forward_hook(watch(name, i)) for i, layer in enumerate(net.layers)]
    rng = np.random.default_rng(0)
    model.eval()
    with torch.no_grad():
        for index in range(NUM_CALIBRATION_GOFS):
            sample = data.sample(rng)
            for _ in closed_loop(model, sample, torch.tensor([2.0 ** (index % 4 - 1)])):
                pass
            if model.has("refinement"):
                model.nets["refinement"](
                    frame_prior(model, sample.positions[0], sample.rotations[0], sample.look)
                )
    for hook in hooks:
        hook.remove()
    return ranges


def _fraction_bits(largest: float, limit: int, most: int) -> int:
    """Most fraction bits at which `largest` is not above `limit`."""
    return min(most, math.floor(math.log2(limit / max(largest, 2.0**-40))))


def _integer_weight(weight: Float64, limit: int, least: int) -> tuple[Int16, int]:
    """Weights within `limit` and their fraction bits, at least `least`: by zeros at the end of each."""
    bits = _fraction_bits(float(np.abs(weight).max()), limit, _MAX_WEIGHT_FRACTION)
    missing = max(0, least - bits)
    integers = np.rint(weight * 2.0**bits).astype(np.int64) << missing
    if np.abs(integers).max() > ACTIVATION_LIMIT:
        raise InputError("weights and activations have too few bits for the format of the output")
    return integers.astype(np.int16), bits + missing


def integer_layers(net: Net, ranges: list[float], bits: tuple[int, int]) -> list[IntegerLayer]:
    """A network in integers; `bits`: of weights and of hidden activations, sign included."""
    weight_limit, hidden_limit = ((1 << (b - 1)) - 1 for b in bits)
    layers, input_bits = [], net.shape.input_bits
    for index, (layer, largest) in enumerate(zip(net.layers, ranges, strict=True)):
        last = index == len(net.layers) - 1
        gains = net.damping.double().numpy() if index == 0 else 1.0
        weight = layer.weight.detach().double().numpy() * gains
        least = net.shape.output_bits - input_bits if last else 0
        integers, weight_bits = _integer_weight(weight, weight_limit, least)
        sum_bits = weight_bits + input_bits
        if last:
            output_bits, limit = net.shape.output_bits, net.shape.output_limit
        else:
            output_bits, limit = _fraction_bits(HEAD_ROOM * largest, hidden_limit, sum_bits), hidden_limit
        shift = sum_bits - output_bits
        half = 1 << (shift - 1) if shift else 0
        bias = np.rint(layer.bias.detach().double().numpy() * 2.0**sum_bits).astype(np.int64) + half
        layers.append(IntegerLayer(integers, bias, shift, limit, not last))
        input_bits = output_bits
    return layers


def _check_sums(name: str, net: Net, layers: list[IntegerLayer]) -> None:
    limit = 32767 if name != "hyper_synthesis" else 1 << 20
    for layer in layers:
        assert layer.largest_sum(limit) < EXACT, f"{name}: sums do not fit float64"
        limit = layer.limit
    assert tuple(len(layer.bias) for layer in layers) == net.shape.widths[1:]


def hyper_frequencies(model: FactorisedModel) -> Int32:
    """(16, 63): of z from -31 to 31, all beyond in the ends; each row sums to 2**24."""
    edges = torch.arange(-HYPER_REACH, HYPER_REACH, dtype=torch.float64) + 0.5
    with torch.no_grad():
        inner = model.cumulative(edges).numpy()
    rows = []
    for row in inner:
        cdf = np.rint(np.concatenate([[0.0], np.maximum.accumulate(row), [1.0]]) * 2.0**_CDF_BITS)
        rows.append(frequencies_from_cdf(cdf.astype(np.int64)))
    return np.array(rows, np.int32)


def integer_arrays(
    model: PaperModel, data: Data, bits: tuple[int, int] = FULL_BITS, part: str = "all"
) -> Arrays:
    """All arrays of the file; networks that are not of the `part` keep 16 bits."""
    ranges = hidden_ranges(model, data)
    arrays: Arrays = {}
    for name, net in model.nets.items():
        layers = integer_layers(net, ranges[name], bits if name in PARTS[part] else FULL_BITS)
        _check_sums(name, net, layers)
        for index, layer in enumerate(layers):
            arrays[f"{name}.{index}.weight"] = layer.weight
            arrays[f"{name}.{index}.bias"] = layer.bias
            scale = np.array([layer.shift, layer.limit, int(layer.leaky)], np.int64)
            arrays[f"{name}.{index}.scale"] = scale
    grid = torch.round(model.grid.detach() * 2.0**GRID_BITS).clamp(-GRID_LIMIT, GRID_LIMIT)
    arrays["grid"] = grid.numpy().astype(np.int8)
    arrays["hyper_frequencies"] = hyper_frequencies(model.factorised)
    return arrays


def _networks(model: PaperModel, arrays: Arrays) -> dict[str, Any]:
    found = {}
    for name, net in model.nets.items():
        scales = [arrays[f"{name}.{index}.scale"].tolist() for index in range(len(net.layers))]
        found[name] = {
            "widths": list(net.shape.widths),
            "input_bits": net.shape.input_bits,
            "output_bits": net.shape.output_bits,
            "shifts": [scale[0] for scale in scales],
        }
    return found


def _commit() -> str:
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def export_run(
    run: Run, data: Data, target: Path, bits: tuple[int, int] = FULL_BITS, part: str = "all"
) -> Path:
    """Write `target`.weights and `target`.json; the path of the first."""
    arrays = integer_arrays(run.model, data, bits, part)
    about = {
        "model_id": target.name,
        "sha256": digest_of(arrays).hex(),
        "nets": _networks(run.model, arrays),
        "bits": {"weights": bits[0], "activations": bits[1], "of": part},
        "training": {
            "scenes": data.scenes,
            **run.config.as_dict(),
            "iterations": run.done,
            "seconds": round(run.seconds),
            "start": run.start,
            "last": run.rows[-1] if run.rows else {},
            "commit": _commit(),
            "torch": torch.__version__,
        },
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    weights, description = (target.with_name(target.name + ending) for ending in (ENDING, ".json"))
    text = json.dumps(about, indent=1) + "\n"
    for path, data in ((weights, file_of(arrays)), (description, text.encode())):
        partial = path.with_name(path.name + ".tmp")
        partial.write_bytes(data)
        os.replace(partial, path)
    return weights
