"""Figures of a model by sequence: bits by control point, distortion relative to repetition."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dfcgs_codec.errors import InputError
from dfcgs_codec.model.weights_file import read_arrays
from training.paper.coding import closed_loop, frame_prior, latents_of
from training.paper.config import HELD_BACK, STEPS
from training.paper.gof import Gof
from training.paper.integers import IntegerModel
from training.paper.losses import POSITION_FLOOR, frame_costs
from training.paper.nets import PaperModel
from training.paper.samples import sample_of
from training.paper.train import Run


def gof_figures(model: PaperModel, gof: Gof, step: float) -> dict[str, float]:
    """Of one GoF in closed loop, at q' = `step`.

    The ratios are those of squared position errors to what repeating the decoded I-frame leaves, pooled over
    the P-frames: of Gaussians that motion reaches, and of all.
    """
    sample = sample_of(gof, everyone=True)
    reached = torch.zeros(gof.num_gaussians, dtype=torch.bool)
    reached[sample.neighbours.reshape(-1)] = True
    sums = {"reached": [0.0, 0.0], "all": [0.0, 0.0]}
    bits = []
    with torch.no_grad():
        for frame, reference, coded in closed_loop(model.eval(), sample, torch.tensor([step])):
            costs = frame_costs(sample, frame, reference, coded)
            bits.append([float(costs.motion_bits), float(costs.hyper_bits)])
            for index, values in enumerate((coded.positions, sample.positions[0])):
                squares = (values - sample.positions[frame]).square().sum(1)
                sums["reached"][index] += float(squares[reached].sum())
                sums["all"][index] += float(squares.sum())
    floor = 4 * POSITION_FLOOR**2 * int(reached.sum()) / 100
    motion, hyper = np.mean(bits, axis=0).tolist()
    return {
        "motion_bits": motion,
        "hyper_bits": hyper,
        "reached_ratio": sums["reached"][0] / (sums["reached"][1] + floor),
        "all_ratio": sums["all"][0] / (sums["all"][1] + floor),
    }


def entropy_bits(integer: IntegerModel, model: PaperModel, gof: Gof, step: float) -> tuple[float, float]:
    """Bits of the same latents of a GoF by the integer entropy model and by the float one it stands for."""
    sample = sample_of(gof)
    rows, look = sample.control, sample.look[sample.control]
    # latents are those of the integer networks; what predicts them is float
    same = copy.deepcopy(model.eval())
    for name in ("analysis", "hyper_analysis"):
        if integer.has(name):
            same.nets[name] = integer.nets[name]
    totals = [0.0, 0.0]
    with torch.no_grad():
        for _, reference, coded in closed_loop(integer, sample, torch.tensor([step])):
            prior = frame_prior(same, reference[0][rows], reference[1][rows], look)
            _, motion_bits, hyper_bits = latents_of(same, coded.motions, prior, torch.tensor([[step]]))
            totals[0] += float(coded.motion_bits.sum() + coded.hyper_bits.sum())
            totals[1] += float(motion_bits.sum() + hyper_bits.sum())
    return totals[0], totals[1]


def entropy_ratio(integer: IntegerModel, model: PaperModel, folder: Path, step: float) -> float:
    """What the integers of the entropy model cost, over one GoF of each sequence."""
    gofs = [Gof.load(path) for path in sorted(folder.glob("*.0.npz"))]
    bits = np.sum([entropy_bits(integer, model, gof, step) for gof in gofs], axis=0)
    return round(float(bits[0] / bits[1]), 6)


def figures(model: PaperModel, folder: Path, step: float, most: int = 4) -> dict[str, dict[str, float]]:
    """Means by sequence, of at most so many GoFs of each."""
    by_scene: dict[str, list[dict[str, float]]] = {}
    for path in sorted(folder.glob("*.npz")):
        rows = by_scene.setdefault(path.name.split(".")[0], [])
        if len(rows) < most:
            rows.append(gof_figures(model, Gof.load(path), step))
    if not by_scene:
        raise InputError(f"{folder} holds no prepared GoFs; `python -m training.paper prepare` makes them")
    return {
        name: {key: round(float(np.mean([row[key] for row in rows])), 4) for key in rows[0]}
        for name, rows in by_scene.items()
    }


def _mean_bits(by_scene: dict[str, dict[str, float]]) -> float:
    return float(np.mean([row["motion_bits"] + row["hyper_bits"] for row in by_scene.values()]))


def _pictures(model: PaperModel, folder: Path) -> dict[str, dict[str, float]]:
    # only this needs numba
    from training.paper.rendering import picture_figures

    gofs = {name: Gof.load(folder / f"{name}.0.npz") for name in HELD_BACK}
    return {name: picture_figures(model, gof, 1.0) for name, gof in gofs.items()}


def report_run(run: Run, folder: Path, model_file: Path | None, *, pictures: bool = False) -> dict[str, Any]:
    """Of the float networks at all steps that were trained, and of the integer ones beside them."""
    models: dict[str, PaperModel] = {"float": run.model}
    if model_file is not None:
        models["integer"] = IntegerModel(read_arrays(model_file))
    found: dict[str, Any] = {"held_back": list(HELD_BACK), "steps": {}}
    for step_log2 in STEPS:
        by_model = {name: figures(model, folder, 2.0**step_log2) for name, model in models.items()}
        if "integer" in by_model:
            ratio = _mean_bits(by_model["integer"]) / _mean_bits(by_model["float"])
            by_model["integer_bits_over_float"] = round(ratio, 5)
            by_model["of_the_same_latents"] = entropy_ratio(
                models["integer"], run.model, folder, 2.0**step_log2
            )
        found["steps"][str(step_log2)] = by_model
    if pictures:
        found["pictures"] = {name: _pictures(model, folder) for name, model in models.items()}
    return found
