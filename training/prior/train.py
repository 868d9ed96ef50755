"""Recordings -> networks -> tables."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.codec.columns.side_information import WEIGHT_FRACTION_BITS
from dfcgs_codec.model.context_model import CONTROL_WEIGHTS
from training.prior import tables
from training.prior.export import Arrays, integer_classes, network_arrays
from training.prior.nets import Batch, ClassNet, FlagLoss, SymbolLoss
from training.prior.untrained import untrained_arrays

PARTS = ("flags", "columns", "control")
BATCH = 4096


@dataclass(frozen=True)
class Config:
    """How long and how wide; `hidden` by part; `masked` inputs (part -> columns) are not looked at."""

    steps: int = 6000
    rate: float = 1e-2
    seed: int = 1
    hidden: dict[str, tuple[int, ...]] = field(default_factory=lambda: dict.fromkeys(PARTS, (8, 8)))
    masked: dict[str, tuple[int, ...]] = field(default_factory=dict)
    #: whether a symbol's kind and the fraction of its prediction choose the table, too
    kinds: bool = True


def load(folder: Path, part: str, names: list[str] | None = None) -> dict[str, AnyArray]:
    """All rows of a part in the recordings of a folder."""
    found: dict[str, list[AnyArray]] = {}
    offset = 0
    for path in sorted(folder.glob("*.npz")):
        if path.stem == "start" or (names is not None and path.stem.split(".")[0] not in names):
            continue
        with np.load(path) as archive:
            for key in archive.files:
                if key.rpartition(".")[0] == part:
                    array = archive[key]
                    if key.endswith(".stream"):
                        array = array + offset
                    found.setdefault(key.rpartition(".")[2], []).append(array)
        offset += 1 << 16
    return {key: np.concatenate(arrays) for key, arrays in found.items()}


def train_part(data: dict[str, AnyArray], part: str, config: Config) -> tuple[ClassNet, float]:
    """The network of a part, and the mean bits of its loss at the end."""
    torch.manual_seed(config.seed)
    inputs = torch.from_numpy(data["inputs"])
    kinds = torch.from_numpy(data["cells"][:, 0].astype(np.int64))
    values = torch.from_numpy(np.abs(data["values"]).astype(np.float32))
    # streams of many symbols count by the square root of their number
    _, place, counts = np.unique(data["stream"], return_inverse=True, return_counts=True)
    chances = (1 / np.sqrt(counts))[place]
    cumulative = np.cumsum(chances) / chances.sum()
    rng = np.random.default_rng(config.seed)
    mask = torch.ones(inputs.shape[1])
    mask[list(config.masked.get(part, ()))] = 0
    net = ClassNet(inputs.shape[1], config.hidden[part], mask)
    loss_of = FlagLoss() if part == "flags" else SymbolLoss()
    parameters = [*net.parameters(), *loss_of.parameters()]
    optimiser = torch.optim.Adam(parameters, config.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.rate, config.steps)
    recent = 0.0
    for step in range(config.steps):
        rows = torch.from_numpy(np.searchsorted(cumulative, rng.random(BATCH)).clip(0, len(values) - 1))
        batch = Batch(inputs[rows].float(), kinds[rows], values[rows])
        loss = loss_of(net(batch.inputs), batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        recent += (loss.item() - recent) * (0.01 if step > 100 else 0.2)
    return net, recent


def control_weights(folder: Path) -> AnyArray:
    """Prediction weights (6, 8), Q8, of control points' columns: least squares, streams of equal weight."""
    weights = np.zeros(CONTROL_WEIGHTS)
    for column in range(CONTROL_WEIGHTS[0]):
        data = load(folder, f"control_{column}")
        if not data:
            continue
        features, goal = data["features"].astype(np.float64), data["values"].astype(np.float64)
        used = np.flatnonzero((features != 0).any(axis=0))
        _, place = np.unique(data["stream"], return_inverse=True)
        solution = np.zeros(len(used))
        for _ in range(5):
            error = np.abs(goal - features[:, used] @ solution)
            # mean magnitude of each stream's error: large ones must not lead
            mean = np.bincount(place, error) / np.bincount(place) + 0.1
            scale = 1 / (mean[place] * np.sqrt(error / mean[place] + 0.1))
            part = features[:, used] * scale[:, None]
            solution = np.linalg.lstsq(part, goal * scale, rcond=None)[0]
        weights[column, used] = solution
    scaled: AnyArray = np.clip(np.rint(weights * (1 << WEIGHT_FRACTION_BITS)), -1024, 1024).astype(np.int16)
    return scaled


def train(folder: Path, config: Config, log: Any = print, parts: tuple[str, ...] = PARTS) -> Arrays:
    """The arrays of a model from the recordings of a folder."""
    arrays = untrained_arrays()
    arrays["control.weights"] = control_weights(folder)
    for part in parts:
        start = time.perf_counter()
        data = load(folder, part)
        net, bits = train_part(data, part, config)
        for name in [n for n in arrays if n.startswith(f"{part}.") and n.split(".")[1].isdigit()]:
            del arrays[name]
        arrays |= network_arrays(net, part)
        arrays |= _tables(arrays, part, data, config.kinds)
        log(f"{part}: {len(data['values'])} symbols, loss {bits:.4f}, {time.perf_counter() - start:.0f} s")
    densities, magnitudes = load(folder, "densities"), load(folder, "magnitudes")
    contexts = [d["contexts"].astype(np.int64) for d in (densities, magnitudes)]
    found = tables.density_frequencies(contexts[0], densities["values"].astype(np.int64))
    arrays["densities.frequencies"] = found.astype(np.int32)
    found = tables.magnitude_tables(contexts[1], magnitudes["values"].astype(np.int64))
    arrays["magnitudes.tables"] = found.astype(np.int16)
    return arrays


def _tables(arrays: Arrays, part: str, data: dict[str, AnyArray], kinds: bool) -> Arrays:
    classes = integer_classes(arrays, part, data["inputs"])
    values = data["values"].astype(np.int64)
    if part == "flags":
        return {"flags.frequencies": tables.flag_frequencies(classes, values).astype(np.int32)}
    cells = data["cells"] if kinds else np.zeros_like(data["cells"])
    found, frequencies = tables.symbol_tables(classes, cells, values)
    if not kinds:
        found = tables.for_all_kinds(found)
    return {
        f"{part}.tables": found.astype(np.int16),
        f"{part}.frequencies": frequencies.astype(np.int32),
    }
