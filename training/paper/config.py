"""What a training run is told, and the stages it has."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

#: held back from training, so that figures on them say something
HELD_BACK = ("barbarian_slice_drift", "morph_pulse_noisy", "rogue_strafe")
STAGES = ("warm_up", "geometry", "rendering")
LEARNING_RATES = {"warm_up": 2e-3, "geometry": 1e-3, "rendering": 2e-4}
#: the learning rate falls to this share of it at the end of a stage
_LAST_SHARE = 0.01
#: log2 of the steps q' that are trained at
STEPS = (-1, 0, 1, 2)


@dataclass(frozen=True)
class Config:
    """A run: iterations of each stage, the weight of rate, GoFs to a batch, and what is left out."""

    seed: int = 1
    warm_up: int = 2000
    geometry: int = 12000
    rendering: int = 800
    rate_weight: float = 1e-3
    batch: int = 2
    without: tuple[str, ...] = ()

    def iterations(self, stage: str) -> int:
        return int(getattr(self, stage))

    @property
    def total(self) -> int:
        return sum(self.iterations(stage) for stage in STAGES)

    def at(self, iteration: int) -> tuple[str, int]:
        """Stage and iteration within it."""
        for stage in STAGES:
            if iteration < self.iterations(stage):
                return stage, iteration
            iteration -= self.iterations(stage)
        raise ValueError("the run is over")

    def learning_rate(self, stage: str, iteration: int) -> float:
        """Cosine."""
        done = iteration / max(1, self.iterations(stage))
        share = _LAST_SHARE + (1 - _LAST_SHARE) * 0.5 * (1 + math.cos(math.pi * done))
        return LEARNING_RATES[stage] * share

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)
