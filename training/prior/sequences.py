"""What is recorded: training scenes, captures, and characters swaying, bending, twisting as a whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

from dfcgs_codec.gaussians import GaussianCloud
from lab.assets import find_asset
from lab.scenes.catalogue import group, scene
from lab.scenes.options import SceneOptions
from lab.scenes.trained import trained_sequence
from lab.scenes.variants import VARIANTS
from training.paper.prepare import training_scenes
from training.prior.recordings import NUM_FRAMES

#: QPs of the scenes, and of what is made of their characters
QPS = (28.0, 18.0, 34.0, 23.0)
FEWER_QPS = (28.0, 20.0)
#: scene whose first frame moves, motion, variant
PROCEDURAL = (
    ("barbarian_chop", "sway", "smooth"),
    ("barbarian_chop", "part", "smooth"),
    ("rogue_stand_up", "bend", "smooth"),
    ("rogue_stand_up", "twist", "noisy"),
    ("fox_survey_drift", "twist", "smooth"),
    ("fox_survey_drift", "part", "drift"),
    ("morph_wave", "sway", "smooth"),
    ("morph_wave", "part", "noisy"),
    ("barbarian_fitted", "bend", "smooth"),
    ("barbarian_fitted", "part", "smooth"),
    ("barbarian_fitted", "sway", "drift"),
    ("rogue_kick_semi", "sway", "semi"),
)


@dataclass(frozen=True)
class Take:
    """A GoF to be recorded."""

    name: str
    frames: list[GaussianCloud]
    qp: float


def takes() -> Iterator[Take]:
    """All of them, in an order in which each needs the frames of its sequence once."""
    for chosen in [*training_scenes(), *group("captures_training")]:
        frames = list(islice(chosen.frames(find_asset(chosen.asset)), NUM_FRAMES))
        for qp in QPS:
            yield Take(chosen.name, frames, qp)
    for index, (name, motion, variant) in enumerate(PROCEDURAL):
        base = scene(name)
        assert base.group == "training", f"{name} is not for training"
        rest = next(iter(replace(base, variant="smooth").frames(find_asset(base.asset))))
        options = SceneOptions(num_frames=NUM_FRAMES, seed=100 + index, fps=30.0)
        frames = list(VARIANTS[variant](trained_sequence(rest, options, motion), options.seed))
        for qp in FEWER_QPS:
            yield Take(f"{name}_{motion}_{variant}", frames, qp)
