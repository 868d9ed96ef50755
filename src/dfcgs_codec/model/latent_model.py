"""The network of profile `paper` (spec annex B): D-FCGS with integers in all that a decoder repeats.

Names in parentheses are the paper's. What only an encoder runs (features, Converter, g_a, h_a) comes from
the same file, so that one file is the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.entropy.coder import Model, categorical
from dfcgs_codec.entropy.tables import NUM_SCALES, SCALES_PER_OCTAVE
from dfcgs_codec.model.hash_grid import HashGrid
from dfcgs_codec.model.layers import ACTIVATION_LIMIT, LayerError, Network
from dfcgs_codec.model.weights_file import Arrays, digest_of, network_of

#: latents of a control point, of motion (y) and of the hyperprior (z)
NUM_LATENTS = 16
#: columns of the spatial-temporal prior
NUM_PRIORS = 16
#: translation and change of the quaternion
NUM_MOTIONS = 7
#: fraction bits of latents and of their means
LATENT_BITS = 6
#: hyperprior latents beyond +- this are escapes
HYPER_REACH = 31
#: name -> (inputs, outputs) of every network that a file may hold
WIDTHS = {
    "position_features": (72, 16),
    "rotation_features": (96, 16),
    "converter": (32, NUM_MOTIONS),
    "analysis": (NUM_MOTIONS, NUM_LATENTS),
    "hyper_analysis": (NUM_LATENTS, NUM_LATENTS),
    "hyper_synthesis": (NUM_LATENTS, NUM_PRIORS),
    "grid_context": (24, NUM_PRIORS),
    "appearance": (56, NUM_PRIORS),
    "fusion": (2 * NUM_PRIORS, 2 * NUM_LATENTS),
    "synthesis": (NUM_LATENTS, NUM_MOTIONS),
    "refinement": (NUM_PRIORS, 45),
}
#: without these there is no motion
_NEEDED = ("position_features", "rotation_features", "converter", "analysis", "fusion", "synthesis")


def _clipped(values: Int64) -> Int64:
    limited: Int64 = np.clip(values, -ACTIVATION_LIMIT, ACTIVATION_LIMIT)
    return limited


@dataclass(frozen=True)
class PriorInputs:
    """What the spatial-temporal prior is computed from, of each of N Gaussians of the reference.

    `normal` (N, 3): normalised positions; `appearance` (N, 56): all other attributes, 12 fraction bits.
    """

    normal: Int64
    appearance: Int64


@dataclass(frozen=True)
class LatentModel:
    """Networks by name, the hash grid, the factorised model of the hyperprior, and their digest (32 bytes).

    Networks of priors, hyperprior and refinement may be absent: then nothing comes from there.
    """

    model_id: str
    digest: bytes
    networks: dict[str, Network]
    grid: HashGrid | None
    hyper_models: list[Model]

    @staticmethod
    def of_arrays(model_id: str, arrays: Arrays) -> LatentModel:
        """LayerError for arrays that do not make a model."""
        networks = {}
        for name, widths in WIDTHS.items():
            network = network_of(arrays, name)
            if network is None:
                if name in _NEEDED:
                    raise LayerError(f"the model has no network {name}")
                continue
            if (network.num_inputs, network.num_outputs) != widths:
                raise LayerError(f"network {name} is {network.num_inputs} to {network.num_outputs} wide")
            networks[name] = network
        grid = None
        if "grid_context" in networks:
            grid = HashGrid(arrays["grid"].astype(np.int8, casting="safe"))
        hyper_models = []
        if "hyper_synthesis" in networks:
            frequencies = arrays["hyper_frequencies"].astype(np.int64)
            if frequencies.shape != (NUM_LATENTS, 2 * HYPER_REACH + 1):
                raise LayerError("the factorised model has another shape than the format's")
            hyper_models = [categorical(row) for row in frequencies]
        return LatentModel(model_id, digest_of(arrays), networks, grid, hyper_models)

    @property
    def has_hyperprior(self) -> bool:
        """Whether there are hyperprior latents (z)."""
        return "hyper_synthesis" in self.networks

    @property
    def has_refinement(self) -> bool:
        """Whether it can refine colours."""
        return "refinement" in self.networks

    def prior(self, inputs: PriorInputs) -> Int64:
        """Spatial-temporal prior (N, 16), 10 fraction bits."""
        total = np.zeros((len(inputs.normal), NUM_PRIORS), np.int64)
        if self.grid is not None:
            total += self.networks["grid_context"](self.grid.read(inputs.normal))
        if "appearance" in self.networks:
            total += self.networks["appearance"](inputs.appearance)
        return _clipped(total)

    def distribution(self, hyper: Int64 | None, prior: Int64, step_log2: int) -> tuple[Int64, Int64]:
        """Means (n, 16), 6 fraction bits, and scale indices (n, 16) of motion latents (prior fusion).

        `hyper` (n, 16) latents of the hyperprior, None without; `prior` (n, 16); the quantisation step q' is
        2**step_log2.
        """
        expected = np.zeros_like(prior) if hyper is None else self.networks["hyper_synthesis"](hyper)
        fused = self.networks["fusion"](np.concatenate([expected, prior], axis=1))
        mean, width = fused[:, :NUM_LATENTS], fused[:, NUM_LATENTS:]
        index = ((width + (1 << (LATENT_BITS - 1))) >> LATENT_BITS) - SCALES_PER_OCTAVE * step_log2
        return mean, np.clip(index, 0, NUM_SCALES - 1)

    def motions(self, latents: Int64) -> Int64:
        """Motions (n, 7), 16 fraction bits, of `latents` (n, 16) with 6 (g_s)."""
        return self.networks["synthesis"](latents)

    def refinements(self, prior: Int64) -> Int64:
        """Changes of SH coefficients (N, 45), 12 fraction bits (colour refinement)."""
        return self.networks["refinement"](prior)


def latents_of(symbols: Int64, mean: Int64, step_log2: int) -> Int64:
    """Latents, 6 fraction bits: mean plus symbols times q'."""
    step = 1 << (LATENT_BITS + step_log2)
    return _clipped(_clipped(symbols) * step + mean)
