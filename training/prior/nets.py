"""The networks of the prior in torch, as floats that behave as the integers will."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from dfcgs_codec.model.context_model import NUM_CLASSES, NUM_FLAG_CLASSES, NUM_KINDS

#: classes of symbols to an octave of their size, and the class of a mean magnitude of 1
CLASSES_PER_OCTAVE = 3
UNIT_CLASS = 12
#: classes of flags to a unit of logit, and the class of even odds
CLASSES_PER_LOGIT = 1.5
EVEN_CLASS = NUM_FLAG_CLASSES // 2
#: hidden activations, as floats, are 0 to this
HIDDEN_LIMIT = 8.0
#: magnitudes from which on each bucket of the loss begins
BUCKETS = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 96, 128, 256, 512, 1024)
_ANCHOR = 0.2


class ClassNet(nn.Module):
    """Inputs (rows, in) as floats of 0 to 255 -> one real number (rows,), the class before rounding."""

    def __init__(self, num_inputs: int, hidden: tuple[int, ...], mask: Tensor | None = None) -> None:
        super().__init__()
        widths = (num_inputs, *hidden, 1)
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        with torch.no_grad():
            # inputs are up to 255, most of them below 64
            self.layers[0].weight.mul_(1 / 32)
        self.register_buffer("mask", torch.ones(num_inputs) if mask is None else mask)

    def forward(self, inputs: Tensor) -> Tensor:
        """Hidden activations are clipped at both ends."""
        values = inputs * self.mask
        for layer in self.layers[:-1]:
            values = layer(values).clamp(0, HIDDEN_LIMIT)
        found: Tensor = self.layers[-1](values)[:, 0]
        return found


@dataclass(frozen=True)
class Batch:
    """Rows of a recording: inputs uint8, kinds int64, values float32 (magnitudes, or flags)."""

    inputs: Tensor
    kinds: Tensor
    values: Tensor


class FlagLoss(nn.Module):
    """Bits of flags whose logit the network gives."""

    def forward(self, logits: Tensor, batch: Batch) -> Tensor:
        """Mean bits."""
        loss = nn.functional.binary_cross_entropy_with_logits(logits, batch.values)
        return loss * 1.442695

    @staticmethod
    def classes(logits: Tensor) -> Tensor:
        """Integer classes."""
        return (logits * CLASSES_PER_LOGIT + EVEN_CLASS + 0.5).floor().clamp(0, NUM_FLAG_CLASSES - 1)


class SymbolLoss(nn.Module):
    """Bits of symbols whose log2 of the mean magnitude the network gives, by tables learnt along with it."""

    def __init__(self) -> None:
        super().__init__()
        # what a table of this size and kind looks like; left behind when the real tables are counted
        self.shape = nn.Sequential(nn.Linear(2 + NUM_KINDS, 32), nn.Tanh(), nn.Linear(32, len(BUCKETS)))
        starts = torch.tensor(BUCKETS, dtype=torch.float32)
        self.register_buffer("starts", starts)

    def forward(self, size: Tensor, batch: Batch) -> Tensor:
        """Mean bits, of the bucket only."""
        kinds = nn.functional.one_hot(batch.kinds, NUM_KINDS).float()
        t = size[:, None]
        logits = self.shape(torch.cat([t, (t / 4) ** 2, kinds], dim=1))
        # buckets far from the size are out of the question from the start
        logits = logits - torch.exp2(torch.log2(self.starts + 0.5) - t).clamp(max=20)
        bucket = torch.bucketize(batch.values, self.starts, right=True) - 1
        bits = nn.functional.cross_entropy(logits, bucket) * 1.442695
        return bits + _ANCHOR * laplace_bits(size, batch.values).mean()

    @staticmethod
    def classes(size: Tensor) -> Tensor:
        """Integer classes."""
        return (size * CLASSES_PER_OCTAVE + UNIT_CLASS + 0.5).floor().clamp(0, NUM_CLASSES - 1)


def laplace_bits(size: Tensor, magnitudes: Tensor) -> Tensor:
    """Bits of integers with a Laplace distribution of scale 2**size, signs included."""
    scale = torch.exp2(size.clamp(-5, 12))
    zero = -torch.log2(1 - torch.exp(-0.5 / scale) + 1e-9)
    other = 1 + (magnitudes - 0.5) / scale * 1.442695 - torch.log2(1 - torch.exp(-1 / scale) + 1e-9)
    return torch.where(magnitudes == 0, zero, other)
