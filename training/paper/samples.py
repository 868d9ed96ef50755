"""Prepared GoFs as tensors in normalised units, augmented, and several of them as one batch."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.transform.spreading import SPREAD_WEIGHT_BITS
from training.paper.gof import Gof

#: columns of `Sample.look`: log-scale 3, opacity 1, SH 48
LOOK_COLUMNS = 52
_ROTATION_ONE = 2.0**24


@dataclass(frozen=True, eq=False)
class Sample:
    """A GoF or several, all float32 in normalised units; A Gaussians, n control points, K neighbours.

    `positions` (5, A, 3), `rotations` (5, A, 4), `look` (A, 52): what appearance reads besides rotation.
    `control` (n,), `neighbours`, `weights` (n, K). `groups` (A,), `control_groups` (n,): which GoF.
    """

    positions: Tensor
    rotations: Tensor
    look: Tensor
    control: Tensor
    neighbours: Tensor
    weights: Tensor
    groups: Tensor
    control_groups: Tensor

    @property
    def num_groups(self) -> int:
        return int(self.groups[-1]) + 1


def _look(gof: Gof) -> np.ndarray:
    """(N, 52): scales and opacity in quarters, SH as it is, absent bands 0."""
    _, scale, opacity, colour = (2.0 ** int(unit) for unit in gof.units)
    look = np.zeros((gof.num_gaussians, LOOK_COLUMNS), np.float32)
    look[:, :3] = (gof.scales * scale - math.log(2.0) * gof.log2_unit) / 4
    look[:, 3:4] = gof.opacities * (opacity / 4)
    look[:, 4 : 4 + gof.colours.shape[1]] = gof.colours * colour
    return look


def sample_of(gof: Gof, *, everyone: bool = False) -> Sample:
    """The Gaussians that motion reaches, or all of them."""
    count = gof.num_gaussians
    rows = np.arange(count)
    if not everyone:
        rows = np.union1d(gof.neighbours.reshape(-1), gof.control)
    places = np.zeros(count, np.int64)
    places[rows] = np.arange(len(rows))
    normalised = (gof.positions[:, rows] - gof.centre) * 2.0 ** -int(gof.extent_log2)
    return Sample(
        positions=torch.from_numpy(normalised.astype(np.float32)),
        rotations=_aligned(torch.from_numpy((gof.rotations[:, rows] / _ROTATION_ONE).astype(np.float32))),
        look=torch.from_numpy(_look(gof)[rows]),
        control=torch.from_numpy(places[gof.control]),
        neighbours=torch.from_numpy(places[gof.neighbours]),
        weights=torch.from_numpy((gof.weights / 2.0**SPREAD_WEIGHT_BITS).astype(np.float32)),
        groups=torch.zeros(len(rows), dtype=torch.int64),
        control_groups=torch.zeros(len(gof.control), dtype=torch.int64),
    )


def _aligned(rotations: Tensor) -> Tensor:
    """Later frames' quaternions with the signs of the first: q and -q are the same rotation."""
    signs = (rotations * rotations[:1]).sum(dim=2, keepdim=True)
    return torch.where(signs < 0, -rotations, rotations)


def joined(samples: list[Sample]) -> Sample:
    """Several as one, rows of the later ones behind those of the earlier."""
    starts = np.cumsum([0, *(sample.positions.shape[1] for sample in samples)]).tolist()
    pairs = list(zip(samples, starts[:-1], strict=True))
    return Sample(
        positions=torch.cat([s.positions for s in samples], dim=1),
        rotations=torch.cat([s.rotations for s in samples], dim=1),
        look=torch.cat([s.look for s in samples]),
        control=torch.cat([s.control + start for s, start in pairs]),
        neighbours=torch.cat([s.neighbours + start for s, start in pairs]),
        weights=torch.cat([s.weights for s in samples]),
        groups=torch.cat([s.groups + i for i, s in enumerate(samples)]),
        control_groups=torch.cat([s.control_groups + i for i, s in enumerate(samples)]),
    )


def product(a: Tensor, b: Tensor) -> Tensor:
    """Hamilton product of quaternions (..., 4)."""
    w, x, y, z = a.unbind(-1)
    s, i, j, k = b.unbind(-1)
    return torch.stack(
        [
            w * s - x * i - y * j - z * k,
            w * i + x * s + y * k - z * j,
            w * j - x * k + y * s + z * i,
            w * k + x * j - y * i + z * s,
        ],
        dim=-1,
    )


def _matrix(quaternion: Tensor) -> Tensor:
    w, x, y, z = quaternion.tolist()
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.tensor(rows)


def _renamed(rotations: Tensor) -> Tensor:
    """The names of axes that the encoder would choose: of four equal turns that with the largest w."""
    largest = rotations[0].abs().argmax(dim=1)
    flips = torch.eye(4)[largest]
    renamed = product(rotations, flips.expand_as(rotations))
    return torch.where(renamed[:1, :, :1] < 0, -renamed, renamed)


def augmented(sample: Sample, rng: np.random.Generator) -> Sample:
    """One GoF turned, scaled, moved more or less, swayed, and with noise."""
    draws = torch.Generator().manual_seed(int(rng.integers(1 << 62)))
    positions, rotations = _moved(sample, rng)
    positions = positions + _sway(positions[0], rng)
    if rng.random() < 0.3:
        noise = torch.randn(positions[1:].shape, generator=draws)
        positions[1:] += noise * float(np.exp(rng.uniform(math.log(1e-5), math.log(1e-3))))
    turn = torch.from_numpy(rng.normal(size=4)).float()
    turn = turn / turn.norm()
    positions = positions @ _matrix(turn).T
    rotations = _renamed(product(turn.expand_as(rotations), rotations))
    # the bulk ends somewhere between 1/2 and 1
    extent = float(torch.quantile(positions[0, ::7].abs(), 0.95, dim=0).max())
    scale = float(rng.uniform(0.5, 1.0)) / max(extent, 1e-3)
    look = sample.look.clone()
    look[:, :3] += math.log(scale) / 4
    centre = torch.from_numpy(rng.normal(0.0, 0.03, 3)).float()
    return replace(sample, positions=positions * scale + centre, rotations=rotations, look=look)


def _moved(sample: Sample, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Positions and rotations with more or less motion about those of the I-frame."""
    gain = float(np.exp(rng.uniform(math.log(0.25), math.log(1.5))))
    positions = sample.positions[:1] + gain * (sample.positions - sample.positions[:1])
    rotations = sample.rotations[:1] + gain * (sample.rotations - sample.rotations[:1])
    return positions, rotations / rotations.norm(dim=2, keepdim=True)


def _sway(start: Tensor, rng: np.random.Generator) -> Tensor:
    """A smooth displacement (5, A, 3) that grows with time, in half of all cases."""
    total = torch.zeros(5, *start.shape)
    if rng.random() < 0.5:
        return total
    amplitude = float(np.exp(rng.uniform(math.log(5e-4), math.log(4e-2))))
    time = torch.arange(5.0)[:, None, None] * amplitude
    for _ in range(3):
        wave, direction = (torch.from_numpy(rng.normal(size=3)).float() for _ in range(2))
        phase = start @ (wave * float(rng.uniform(0.3, 2.5))) + float(rng.uniform(0, 2 * math.pi))
        total += time * torch.sin(phase)[None, :, None] * direction / 3
    return total
