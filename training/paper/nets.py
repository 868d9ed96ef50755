"""The networks of D-FCGS in float, with the widths, formats and clipping of the integer ones.

Deviations from the published model: no normalisation layers, LeakyReLU of slope 1/128 throughout, the hash
grid small and over normalised positions, a scale of 2**((r - 26) / 6) instead of softplus, no normalisation
of priors. A network may be left out for ablations: `hyperprior`, `prior` or `refinement`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import leaky_relu

from training.paper.factorised import FactorisedModel
from training.paper.inputs import GRID_LEVELS, GRID_ROWS, NUM_OCTAVES, interpolate

#: negative values are shifted right by this
LEAKY_SHIFT = 7
ACTIVATION_LIMIT = 32767
#: latents y and their means have this many fraction bits
LATENT_BITS = 6
NUM_CHANNELS = 16
GRID_FEATURES, GRID_BITS, GRID_LIMIT = 4, 6, 127
#: sigma = 2**((r - SCALE_ORIGIN) / SCALES_PER_OCTAVE), as the frozen tables stand
SCALE_ORIGIN, SCALES_PER_OCTAVE, NUM_SCALES = 26, 6, 160


@dataclass(frozen=True)
class Shape:
    """Widths of a network, fraction bits of what goes in and comes out, and the limit of what comes out."""

    widths: tuple[int, ...]
    input_bits: int
    output_bits: int
    output_limit: int = ACTIVATION_LIMIT

    @property
    def limit(self) -> float:
        return self.output_limit / 2.0**self.output_bits


SHAPES = {
    "position_features": Shape((72, 128, 128, 128, 16), 12, 10),
    "rotation_features": Shape((96, 128, 128, 128, 16), 12, 10),
    "converter": Shape((32, 64, 64, 7), 10, 12),
    "analysis": Shape((7, 64, 64, 64, 16), 12, 6),
    "hyper_analysis": Shape((16, 64, 64, 16), 6, 6),
    "hyper_synthesis": Shape((16, 64, 64, 16), 0, 10),
    "grid_context": Shape((24, 128, 128, 128, 16), 12, 10),
    "appearance": Shape((56, 64, 64, 16), 12, 10),
    "fusion": Shape((32, 64, 64, 32), 10, 6),
    "synthesis": Shape((16, 64, 64, 64, 7), 6, 16, 1 << 22),
    "refinement": Shape((16, 64, 64, 64, 45), 10, 12),
}
#: what an ablation leaves out; a refinement by priors is nothing without them
ABLATIONS = {
    "hyperprior": ("hyper_analysis", "hyper_synthesis"),
    "prior": ("grid_context", "appearance", "refinement"),
    "refinement": ("refinement",),
}
#: what predicts latents, and all that a decoder runs
PARTS = {
    "entropy": ("hyper_synthesis", "grid_context", "appearance", "fusion"),
    "decoder": ("hyper_synthesis", "grid_context", "appearance", "fusion", "synthesis", "refinement"),
    "all": tuple(SHAPES),
}
#: the first and last weights of these begin larger or smaller than usual: latents are in the hundreds where
#: motion is in hundredths
_GAINS = {
    "analysis": (4.0, 16.0),
    "hyper_analysis": (0.1, 0.1),
    "synthesis": (0.1, 1.0),
    "refinement": (1.0, 0.0),
}


def rounded(values: Tensor, fraction_bits: int) -> Tensor:
    """Values on the grid, as if they had not been rounded to those that differentiate."""
    one = 2.0**fraction_bits
    return values + (torch.round(values.detach() * one) / one - values.detach())


def _damping(name: str, width: int) -> Tensor:
    """Gains of inputs: octaves of a frequency encoding begin with equal slopes; export folds them in."""
    if not name.endswith("_features"):
        return torch.ones(width)
    return 2.0 ** -torch.arange(NUM_OCTAVES).repeat_interleave(width // NUM_OCTAVES).float()


class Net(nn.Module):
    """Dense layers, LeakyReLU between them; what comes out is clipped and rounded to the format.

    In training uniform noise stands for the rounding.
    """

    def __init__(self, name: str) -> None:
        super().__init__()
        self.shape = SHAPES[name]
        widths = self.shape.widths
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.register_buffer("damping", _damping(name, widths[0]), persistent=False)
        for layer in self.layers:
            nn.init.kaiming_uniform_(layer.weight, a=2.0**-LEAKY_SHIFT)
            nn.init.zeros_(layer.bias)
        first, last = _GAINS.get(name, (1.0, 0.5))
        with torch.no_grad():
            self.layers[0].weight *= first
            self.layers[-1].weight *= last

    def forward(self, values: Tensor) -> Tensor:
        values = values * self.damping
        for layer in self.layers[:-1]:
            values = leaky_relu(layer(values), 2.0**-LEAKY_SHIFT)
        values = self.layers[-1](values).clamp(-self.shape.limit, self.shape.limit)
        if self.training:
            return values + (torch.rand_like(values) - 0.5) * 2.0**-self.shape.output_bits
        return rounded(values, self.shape.output_bits)


class PaperModel(nn.Module):
    """All networks, the hash grid and the distribution of hyper latents."""

    def __init__(self, without: frozenset[str] = frozenset()) -> None:
        super().__init__()
        left_out = {name for ablation in without for name in ABLATIONS[ablation]}
        self.without = without
        self.nets = nn.ModuleDict({name: Net(name) for name in SHAPES if name not in left_out})
        self.grid = nn.Parameter(torch.empty(GRID_LEVELS, GRID_ROWS, GRID_FEATURES).uniform_(-0.1, 0.1))
        self.factorised = FactorisedModel(NUM_CHANNELS)
        with torch.no_grad():
            # sigma 2 where nothing is known yet
            self.nets["fusion"].layers[-1].bias[NUM_CHANNELS:] = SCALE_ORIGIN + SCALES_PER_OCTAVE

    def has(self, name: str) -> bool:
        return name in self.nets

    def motion(self, target: tuple[Tensor, Tensor], reference: tuple[Tensor, Tensor]) -> Tensor:
        """Motion tensors of control points: Converter of the difference of features.

        target, reference: frequency encodings of positions and of rotations.
        """
        differences = []
        for name, after, before in zip(("position", "rotation"), target, reference, strict=True):
            features = self.nets[f"{name}_features"](torch.cat([after, before]))
            after_features, before_features = features.chunk(2)
            differences.append(after_features - before_features)
        limit = ACTIVATION_LIMIT / 2.0 ** SHAPES["converter"].input_bits
        return self.nets["converter"](torch.cat(differences, dim=1).clamp(-limit, limit))

    def prior(self, corners: tuple[Tensor, Tensor], appearance: Tensor) -> Tensor:
        """Spatial-temporal priors: the context of the hash grid plus appearance features."""
        total = torch.zeros(len(appearance), NUM_CHANNELS)
        if self.has("grid_context"):
            total = total + self.nets["grid_context"](self.interpolated(corners))
        if self.has("appearance"):
            total = total + self.nets["appearance"](appearance)
        limit = ACTIVATION_LIMIT / 2.0 ** SHAPES["fusion"].input_bits
        return total.clamp(-limit, limit)

    def interpolated(self, corners: tuple[Tensor, Tensor]) -> Tensor:
        """Features of the hash grid, whose integers have 8 bits."""
        grid = rounded(self.grid, GRID_BITS).clamp(-GRID_LIMIT / 2.0**GRID_BITS, GRID_LIMIT / 2.0**GRID_BITS)
        return interpolate(grid, *corners)

    def distribution(self, hyper: Tensor | None, prior: Tensor) -> tuple[Tensor, Tensor]:
        """Means and scale indices r of latents, by the fusion of both priors; `hyper`: z, or None."""
        if hyper is None:
            known = torch.zeros(len(prior), NUM_CHANNELS)
        else:
            known = self.nets["hyper_synthesis"](hyper)
        return self.nets["fusion"](torch.cat([known, prior], dim=1)).chunk(2, dim=1)
