"""What an iteration of the second and third stage minimises, and what is noted of it."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from training.paper.coding import closed_loop
from training.paper.config import STEPS, Config
from training.paper.data import Data
from training.paper.losses import ROTATION_WEIGHT, frame_costs, geometry_loss
from training.paper.nets import PaperModel

#: of the geometry's distortion beside the relative render loss
GEOMETRY_SHARE = 0.5
#: render losses below this count little
RENDER_FLOOR = 1e-3


def _draw_steps(count: int, rng: np.random.Generator) -> Tensor:
    return torch.from_numpy(2.0 ** rng.choice(STEPS, count)).float()


def geometry(
    model: PaperModel, config: Config, data: Data, rng: np.random.Generator
) -> tuple[Tensor, dict[str, float]]:
    """Loss of a batch of GoFs, and what is noted of it."""
    batch = data.batch(config.batch, rng)
    step = _draw_steps(batch.num_groups, rng)
    losses, notes = [], []
    for frame, reference, coded in closed_loop(model, batch, step):
        costs = frame_costs(batch, frame, reference, coded)
        losses.append(geometry_loss(costs, step, config.rate_weight))
        values = (costs.position_ratio, costs.rotation_ratio, costs.motion_bits, costs.hyper_bits)
        notes.append([float(value.detach().mean()) for value in values])
    names = ("position_ratio", "rotation_ratio", "motion_bits", "hyper_bits")
    return torch.stack(losses).mean(), dict(zip(names, np.mean(notes, axis=0).tolist(), strict=True))


def rendering(
    model: PaperModel, config: Config, data: Data, rng: np.random.Generator
) -> tuple[Tensor, dict[str, float]]:
    """The same of one GoF with pictures of one camera."""
    # the renderer is compiled by numba; the stages before do without
    from training.paper.rendering import Stage, rendered_loop

    gof = data.gof(rng)
    stage, view = Stage.of(gof), int(rng.integers(len(gof.images)))
    step = _draw_steps(1, rng)
    losses, notes = [], []
    for frame, rendered in rendered_loop(model, stage, step, view):
        costs = frame_costs(stage.sample, frame, rendered.reference, rendered.coded)
        relative = rendered.loss / (rendered.repeated + RENDER_FLOOR)
        distortion = costs.position_ratio + ROTATION_WEIGHT * costs.rotation_ratio
        rate = config.rate_weight * step.square() * costs.bits
        losses.append(((relative + GEOMETRY_SHARE * distortion + rate) / step).mean())
        values = (relative, rendered.unrefined / (rendered.repeated + RENDER_FLOOR), costs.position_ratio)
        rates = (costs.motion_bits, costs.hyper_bits)
        notes.append([float(value.detach().mean()) for value in (*values, *rates)])
    names = ("render_ratio", "unrefined_ratio", "position_ratio", "motion_bits", "hyper_bits")
    return torch.stack(losses).mean(), dict(zip(names, np.mean(notes, axis=0).tolist(), strict=True))
