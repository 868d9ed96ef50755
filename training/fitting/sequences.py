"""The fitted sequences by name, and the true frames that they are fitted to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from dfcgs_codec.array_types import Bool
from dfcgs_codec.gaussians import GaussianCloud
from lab.assets import find_asset
from lab.scenes.animated import animated_sequence
from lab.scenes.options import SceneOptions
from training.fitting.stage import join, stage_cloud


@dataclass(frozen=True)
class FittedSequence:
    """One sequence: `clip` of `asset`, at `fps` frames a second of the asset's own time, without `skipped`.

    The true frames have `true_character` and `true_stage` Gaussians, the fitted ones `character` and `stage`;
    `first_steps` and `later_steps` are steps of Adam in frame 0 and in each later one.
    """

    asset: str
    clip: str
    fps: float
    skipped: int = 0
    character: int = 12_000
    stage: int = 7_000
    true_character: int = 100_000
    true_stage: int = 60_000
    sh_degree: int = 1
    seed: int = 0
    first_steps: int = 3000
    later_steps: int = 200


@dataclass(frozen=True, eq=False)
class TrueFrame:
    """A frame of the truth and which of its Gaussians are the character's, (N,) bool."""

    cloud: GaussianCloud
    is_character: Bool


#: for training and for evaluation: no character and no clip in common
FITTED: dict[str, FittedSequence] = {
    # half speed: at 30 fps the axe moves 12 pixels a frame
    "fitted_barbarian": FittedSequence("Barbarian.glb", "PickUp", 60.0),
    # without the swing of the staff that begins the clip: 1.1 units a frame, which no fit follows
    "fitted_mage": FittedSequence("Mage.glb", "Cheer", 30.0, skipped=5),
}


def true_frames(sequence: FittedSequence, num_frames: int) -> Iterator[TrueFrame]:
    """The truth: the character in motion on its still stage."""
    options = SceneOptions(
        num_frames + sequence.skipped,
        sequence.true_character,
        sequence.sh_degree,
        sequence.seed,
        sequence.fps,
    )
    stage = stage_cloud(sequence.true_stage, sequence.sh_degree, sequence.seed)
    is_character = np.arange(sequence.true_character + sequence.true_stage) < sequence.true_character
    moving = animated_sequence(find_asset(sequence.asset), options, sequence.clip)
    for character in islice(moving, sequence.skipped, None):
        yield TrueFrame(join(character, stage), is_character)
