"""First of all: motion tensors are displacements, and latents let them through, on random pairs of points.

From random weights, features whose differences are motion are slow to be found by the losses of whole GoFs.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from training.paper.coding import encodings
from training.paper.losses import POSITION_FLOOR
from training.paper.nets import PaperModel

NUM_PAIRS = 1024
#: displacements of normalised positions, and noise of latents (log2)
MOTIONS = (2e-4, 0.4)
STEPS = (-3, 2)
#: motion tensors are this many times the displacement, what a control point sends is about K times
MOTION_GAIN, SENT_GAIN = 8.0, 28.8
_LATENT_WEIGHT = 1e-4


def _unit(values: Tensor) -> Tensor:
    return values / values.norm(dim=1, keepdim=True)


def warm_up_loss(model: PaperModel) -> Tensor:
    """Of one batch of pairs, drawn from torch's own generator."""
    low, high = (math.log(value) for value in MOTIONS)
    size = torch.exp(torch.rand(NUM_PAIRS, 1) * (high - low) + low)
    moved = _unit(torch.randn(NUM_PAIRS, 3)) * size
    start = torch.rand(NUM_PAIRS, 3) * 2.4 - 1.2
    rotation = _unit(torch.randn(NUM_PAIRS, 4))
    turned = _unit(rotation + torch.randn(NUM_PAIRS, 4) * size)
    motions = model.motion(encodings(start + moved, turned), encodings(start, rotation))
    latents = model.nets["analysis"](motions)
    step = 2.0 ** torch.randint(*STEPS, (NUM_PAIRS, 1))
    sent = model.nets["synthesis"](latents + (torch.rand_like(latents) - 0.5) * step)
    scale = moved.square().sum(1) + POSITION_FLOOR**2
    found = (motions[:, :3] / MOTION_GAIN - moved).square().sum(1) / scale
    arrived = (sent[:, :3] / SENT_GAIN - moved).square().sum(1) / scale
    return found.mean() + torch.log1p(arrived).mean() + _LATENT_WEIGHT * latents.abs().mean()
