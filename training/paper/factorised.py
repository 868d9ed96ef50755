"""The fully factorised distribution of Ballé et al. 2018, appendix 6.1, with filters (3, 3, 3)."""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import softplus

FILTERS = (1, 3, 3, 3, 1)
_INITIAL_SCALE = 1.0
#: the smallest probability that is taken the logarithm of
LIKELIHOOD_BOUND = 2.0**-24


class FactorisedModel(nn.Module):
    """A learnt density for each channel, from the logit of its cumulative."""

    def __init__(self, num_channels: int) -> None:
        super().__init__()
        self.matrices, self.biases, self.factors = nn.ParameterList(), nn.ParameterList(), nn.ParameterList()
        scale = _INITIAL_SCALE ** (1 / (len(FILTERS) - 1))
        for inputs, outputs in pairwise(FILTERS):
            start = math.log(math.expm1(1 / scale / outputs))
            self.matrices.append(nn.Parameter(torch.full((num_channels, outputs, inputs), start)))
            self.biases.append(nn.Parameter(torch.empty(num_channels, outputs, 1).uniform_(-0.5, 0.5)))
            self.factors.append(nn.Parameter(torch.zeros(num_channels, outputs, 1)))

    def logits(self, values: Tensor) -> Tensor:
        """Logits of the cumulative at `values` (channels, 1, rows)."""
        for index, (matrix, bias) in enumerate(zip(self.matrices, self.biases, strict=True)):
            values = softplus(matrix) @ values + bias
            if index < len(self.matrices) - 1:
                values = values + torch.tanh(self.factors[index]) * torch.tanh(values)
        return values

    def bits(self, values: Tensor) -> Tensor:
        """Bits of each of `values` (rows, channels), in bins of width 1."""
        columns = values.T[:, None, :]
        lower, upper = self.logits(columns - 0.5), self.logits(columns + 0.5)
        # on the side where both are small
        sign = -torch.sign(lower + upper).detach()
        probability = (torch.sigmoid(sign * upper) - torch.sigmoid(sign * lower)).abs()
        return -torch.log2(probability.clamp(min=LIKELIHOOD_BOUND))[:, 0, :].T

    def cumulative(self, edges: Tensor) -> Tensor:
        """Of each channel at `edges` (count,): (channels, count), float64."""
        columns = edges.to(torch.float32).expand(len(self.matrices[0]), 1, -1)
        return torch.sigmoid(self.logits(columns).double())[:, 0, :]
