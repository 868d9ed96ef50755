"""The prepared GoFs that are trained on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dfcgs_codec.errors import InputError
from training.paper.config import HELD_BACK
from training.paper.gof import Gof
from training.paper.samples import Sample, augmented, joined, sample_of


class Data:
    """Prepared GoFs of a folder, without those held back; each is read when it is first wanted."""

    def __init__(self, folder: Path, num_cached: int = 200) -> None:
        self.paths = [p for p in sorted(folder.glob("*.npz")) if p.name.split(".")[0] not in HELD_BACK]
        if not self.paths:
            raise InputError(
                f"{folder} holds no prepared GoFs; `python -m training.paper prepare` makes them"
            )
        self._samples: dict[Path, Sample] = {}
        self._num_cached = num_cached

    @property
    def scenes(self) -> list[str]:
        return sorted({path.name.split(".")[0] for path in self.paths})

    def sample(self, rng: np.random.Generator) -> Sample:
        """One GoF, augmented."""
        path = self.paths[int(rng.integers(len(self.paths)))]
        if path not in self._samples and len(self._samples) < self._num_cached:
            self._samples[path] = sample_of(Gof.load(path))
        return augmented(self._samples.get(path) or sample_of(Gof.load(path)), rng)

    def batch(self, count: int, rng: np.random.Generator) -> Sample:
        return joined([self.sample(rng) for _ in range(count)])

    def gof(self, rng: np.random.Generator) -> Gof:
        return Gof.load(self.paths[int(rng.integers(len(self.paths)))])
