"""Rate and distortion of coded frames; the distortion is relative to what repeating the reference leaves."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from training.paper.coding import Coded
from training.paper.samples import Sample

#: errors that count little: of a normalised position, of a quaternion
POSITION_FLOOR, ROTATION_FLOOR = 3e-4, 0.02
ROTATION_WEIGHT = 0.1


@dataclass(frozen=True, eq=False)
class FrameCosts:
    """By GoF: squared position errors of the coded and of the repeated frame, the same of rotations (as
    ratios), bits by control point of latents and hyper latents."""

    position_error: Tensor
    position_repeated: Tensor
    rotation_ratio: Tensor
    motion_bits: Tensor
    hyper_bits: Tensor

    @property
    def position_ratio(self) -> Tensor:
        return self.position_error / self.position_repeated

    @property
    def bits(self) -> Tensor:
        return self.motion_bits + self.hyper_bits


def _sums(values: Tensor, groups: Tensor, count: int) -> Tensor:
    return torch.zeros(count).index_add(0, groups, values)


def frame_costs(sample: Sample, frame: int, reference: tuple[Tensor, Tensor], coded: Coded) -> FrameCosts:
    """Of one frame, against the true one."""
    count, groups = sample.num_groups, sample.groups
    sizes = _sums(torch.ones(len(groups)), groups, count)
    points = _sums(torch.ones(len(sample.control)), sample.control_groups, count)
    target = sample.positions[frame]
    error = _sums((coded.positions - target).square().sum(1), groups, count)
    repeated = _sums((reference[0] - target).square().sum(1), groups, count)
    turned = _sums(turn_error(coded.rotations, sample.rotations[frame]), groups, count)
    kept = _sums(turn_error(reference[1], sample.rotations[frame]), groups, count)
    return FrameCosts(
        error,
        repeated + sizes * POSITION_FLOOR**2,
        turned / (kept + sizes * ROTATION_FLOOR**2),
        _sums(coded.motion_bits.sum(1), sample.control_groups, count) / points,
        _sums(coded.hyper_bits.sum(1), sample.control_groups, count) / points,
    )


def turn_error(quaternions: Tensor, target: Tensor) -> Tensor:
    """Squared distance of quaternions (rows,), of either sign."""
    same = (quaternions * target).sum(1).abs()
    return (2.0 - 2.0 * same).clamp(min=0.0)


def geometry_loss(costs: FrameCosts, step: Tensor, rate_weight: float) -> Tensor:
    """Distortion plus rate; the weight of rate goes with the square of q', so that one model serves a sweep.

    Divided by q', so that coarse steps do not outweigh fine ones.
    """
    distortion = costs.position_ratio + ROTATION_WEIGHT * costs.rotation_ratio
    return ((distortion + rate_weight * step.square() * costs.bits) / step).mean()
