"""What the networks read, as the codec computes it: integers first, then their meaning in float."""

from __future__ import annotations

import math

import torch
from torch import Tensor

#: fraction bits of normalised positions, and their limit
POSITION_BITS, POSITION_LIMIT = 15, 1 << 17
NUM_OCTAVES = 12
INPUT_BITS = 12
INPUT_LIMIT = 32767
GRID_LEVELS, GRID_ROWS = 6, 4096
#: cells across [-1, 1): 2**(level + this)
_FIRST_LEVEL_BITS = 2
_PRIMES = (1, 2654435761, 805459861)


def fixed(values: Tensor, fraction_bits: int, limit: int) -> Tensor:
    """Nearest integers (int64) of values in that format."""
    return torch.round(values.double() * 2.0**fraction_bits).clamp(-limit, limit).long()


def frequencies(values: Tensor) -> Tensor:
    """FreqEnc of the paper: sin and cos of pi 2**o v for 12 octaves, rounded to 12 bits.

    values (rows, C) float64 -> (rows, 24 C): octave by octave, the sines of all components, then the cosines.
    """
    octaves = 2.0 ** torch.arange(NUM_OCTAVES, dtype=torch.float64)
    angles = math.pi * octaves[None, :, None, None] * values.double()[:, None, None, :]
    waves = torch.cat([torch.sin(angles), torch.cos(angles)], dim=2)
    one = 2.0**INPUT_BITS
    return (torch.round(waves * one) / one).reshape(len(values), -1).float()


def grid_corners(positions: Tensor) -> tuple[Tensor, Tensor]:
    """Rows of the hash grid and weights in 2**-24 of the eight corners, both int64 (rows, levels, 8).

    positions (rows, 3) int64: normalised, with 15 fraction bits.
    """
    half = 1 << POSITION_BITS
    inside = positions.clamp(-half, half - 1) + half
    offsets = torch.tensor([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
    all_rows, all_weights = [], []
    for level in range(GRID_LEVELS):
        bits = level + _FIRST_LEVEL_BITS
        cell = inside >> (POSITION_BITS + 1 - bits)
        fraction = (inside >> (POSITION_BITS - 7 - bits)) & 255
        corner = cell[:, None, :] + offsets
        share = torch.where(offsets.bool(), fraction[:, None, :], 256 - fraction[:, None, :])
        all_rows.append(_corner_rows(corner, bits))
        all_weights.append(share.prod(dim=2))
    return torch.stack(all_rows, dim=1), torch.stack(all_weights, dim=1)


def _corner_rows(corner: Tensor, bits: int) -> Tensor:
    x, y, z = corner.unbind(-1)
    width = (1 << bits) + 1
    if width**3 <= GRID_ROWS:
        return x + width * (y + width * z)
    hashed = x ^ (y * _PRIMES[1]) ^ (z * _PRIMES[2])
    return hashed & 0xFFFFFFFF & (GRID_ROWS - 1)


def interpolate(grid: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
    """Interp of the paper, all levels concatenated: (rows, levels * 4), differentiable by the grid."""
    levels, size, features = grid.shape
    flat = (rows + size * torch.arange(levels)[:, None]).reshape(-1, 8)
    shares = (weights.float() * 2.0**-24).reshape(-1, 8, 1)
    # an index_select: the gradient of an embedding sorts its rows, which takes ten times as long
    found = grid.reshape(-1, features).index_select(0, flat.reshape(-1)).reshape(-1, 8, features)
    return (found * shares).sum(dim=1).reshape(len(rows), levels * features)


def input_format(values: Tensor) -> Tensor:
    """Rounded to 12 bits and clipped, as all columns of appearance are."""
    return fixed(values, INPUT_BITS, INPUT_LIMIT).float() / 2.0**INPUT_BITS
