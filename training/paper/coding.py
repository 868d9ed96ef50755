"""A batch through the codec: motion, latents, rates, compensation; the loop closed over a GoF."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from training.paper.inputs import (
    POSITION_BITS,
    POSITION_LIMIT,
    fixed,
    frequencies,
    grid_corners,
    input_format,
)
from training.paper.nets import (
    LATENT_BITS,
    NUM_SCALES,
    SCALE_ORIGIN,
    SCALES_PER_OCTAVE,
    PaperModel,
)
from training.paper.samples import Sample

#: sigma of float training is at most this; tables go further, latents do not
_MAX_SIGMA = 1024.0
_LATENT_LIMIT = 32767 / 2.0**LATENT_BITS


@dataclass(frozen=True, eq=False)
class Coded:
    """One P-frame: bits of latents and hyper latents by control point and channel (n, 16), and the result.

    `motions`: the motion tensors that went in, `spread` (n, 7): what came out. `prior`: at control points.
    """

    positions: Tensor
    rotations: Tensor
    motion_bits: Tensor
    hyper_bits: Tensor
    motions: Tensor
    spread: Tensor


def gaussian_bits(offsets: Tensor, sigma: Tensor) -> Tensor:
    """Bits of a bin of width 1 at `offsets` from the mean of a normal distribution; exact far out too."""
    distance = offsets.abs()
    upper = torch.special.log_ndtr((0.5 - distance) / sigma)
    lower = torch.special.log_ndtr((-0.5 - distance) / sigma)
    log_probability = upper + torch.log(-torch.expm1((lower - upper).clamp(max=-1e-7)))
    return log_probability * (-1.0 / math.log(2.0))


def sigma_of(scales: Tensor, step: Tensor) -> Tensor:
    """Standard deviations in symbols, of scale indices for a step of 1; within those of the tables."""
    index = (scales - SCALES_PER_OCTAVE * torch.log2(step)).clamp(0, NUM_SCALES - 1)
    return torch.exp2((index - SCALE_ORIGIN) / SCALES_PER_OCTAVE).clamp(max=_MAX_SIGMA)


def _noise(values: Tensor) -> Tensor:
    return torch.rand_like(values) - 0.5


def nearest(values: Tensor) -> Tensor:
    """Integers, halves up."""
    return torch.floor(values + 0.5)


def hyper_latents(model: PaperModel, latents: Tensor) -> tuple[Tensor | None, Tensor]:
    """z with noise or rounded, None where there is no hyperprior, and its bits (n, 16)."""
    if not model.has("hyper_analysis"):
        return None, torch.zeros_like(latents)
    exact = model.nets["hyper_analysis"](latents)
    hyper = exact + _noise(exact) if model.training else nearest(exact)
    return hyper, model.factorised.bits(hyper)


def latents_of(
    model: PaperModel, motions: Tensor, prior: Tensor, step: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Decoded latents, bits of their symbols and of hyper latents, all (n, 16); `step`: q', (n, 1)."""
    latents = model.nets["analysis"](motions)
    hyper, hyper_bits = hyper_latents(model, latents)
    mean, scales = model.distribution(hyper, prior)
    exact = (latents - mean) / step
    symbols = exact + _noise(exact) if model.training else nearest(exact)
    sigma = sigma_of(scales if model.training else nearest(scales), step)
    decoded = (symbols * step + mean).clamp(-_LATENT_LIMIT, _LATENT_LIMIT)
    return decoded, gaussian_bits(symbols, sigma), hyper_bits


def frame_prior(model: PaperModel, positions: Tensor, rotations: Tensor, look: Tensor) -> Tensor:
    """Spatial-temporal priors of Gaussians of the reference."""
    corners = grid_corners(fixed(positions, POSITION_BITS, POSITION_LIMIT))
    columns = torch.cat([look[:, :3], rotations, look[:, 3:]], dim=1)
    return model.prior(corners, input_format(columns))


def encodings(positions: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
    """FreqEnc of normalised positions and of quaternions."""
    grid = fixed(positions, POSITION_BITS, POSITION_LIMIT).double() / 2.0**POSITION_BITS
    return frequencies(grid), frequencies(rotations)


def compensate(sample: Sample, spread: Tensor, positions: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
    """The paper's compensation: every Gaussian adds what control points send it, quaternions made unit."""
    shares = (sample.weights[:, :, None] * spread[:, None, :]).reshape(-1, spread.shape[1])
    received = torch.zeros(len(positions), spread.shape[1]).index_add(
        0, sample.neighbours.reshape(-1), shares
    )
    turned = rotations + received[:, 3:].clamp(-1.0, 1.0)
    return positions + received[:, :3], turned / turned.norm(dim=1, keepdim=True).clamp(min=1e-6)


def code_frame(
    model: PaperModel, sample: Sample, frame: int, reference: tuple[Tensor, Tensor], step: Tensor
) -> Coded:
    """Frame `frame` of `sample` after the decoded `reference`, at q' = `step` (n, 1)."""
    rows = sample.control
    positions, rotations = (values[rows] for values in reference)
    target = sample.rotations[frame][rows]
    aligned = torch.where((target * rotations).sum(dim=1, keepdim=True) < 0, -target, target)
    motions = model.motion(encodings(sample.positions[frame][rows], aligned), encodings(positions, rotations))
    prior = frame_prior(model, positions, rotations, sample.look[rows])
    decoded, motion_bits, hyper_bits = latents_of(model, motions, prior, step)
    spread = model.nets["synthesis"](decoded)
    carried = compensate(sample, spread, *reference)
    return Coded(*carried, motion_bits, hyper_bits, motions, spread)


def closed_loop(
    model: PaperModel, sample: Sample, step: Tensor
) -> Iterator[tuple[int, tuple[Tensor, Tensor], Coded]]:
    """Frame numbers, references and coded frames of a GoF; the reference is detached each frame.

    step: q' of each GoF of the sample (groups,).
    """
    reference = sample.positions[0], sample.rotations[0]
    by_point = step[sample.control_groups][:, None]
    for frame in range(1, len(sample.positions)):
        coded = code_frame(model, sample, frame, reference, by_point)
        yield frame, reference, coded
        reference = coded.positions.detach(), coded.rotations.detach()
