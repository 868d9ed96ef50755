"""Frame 0 of a capture: optimised from random Gaussians, with checkpoints to go on from."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.captures.captures import Capture
from lab.render import View
from training.captures.densify import Pull, densify, reset_opacities
from training.fitting.adam import Adam, decayed
from training.fitting.first import RATES
from training.fitting.loss import loss_gradient

#: of the positions, first and last, shares of the size of the capture
POSITION_RATES = (1.6e-4, 1.6e-6)
#: steps between two densifications and between two resets of the opacities
DENSIFY_EVERY, RESET_EVERY = 100, 1500
#: densification begins at this step and ends at this share of all steps, as resets do
DENSIFY_FROM, DENSIFY_UNTIL = 300, 0.6
#: steps between two checkpoints
SAVE_EVERY = 250
#: keeps the random numbers apart from those of other stages with the same seed
STEP_STREAM = 62

Progress = Callable[[int, float, int], None]


@dataclass
class State:
    """What a checkpoint holds: the Gaussians with their optimiser, the pull since the last densifying."""

    adam: Adam
    pull: Pull

    @classmethod
    def of(cls, cloud: GaussianCloud) -> State:
        """Before the first step."""
        values = {field.name: getattr(cloud, field.name).copy() for field in fields(cloud)}
        return cls(Adam(values), Pull.none(cloud.num_gaussians))

    @property
    def cloud(self) -> GaussianCloud:
        """The Gaussians; shares the arrays."""
        return GaussianCloud(**self.adam.values)


def optimise(
    start: GaussianCloud,
    capture: Capture,
    views: Sequence[View],
    checkpoint: Path,
    progress: Progress | None = None,
) -> GaussianCloud:
    """The cloud after `capture.first_steps` steps, one random view each, or from `checkpoint` on.

    progress: called with the step, its loss and the number of Gaussians.
    """
    state = load(checkpoint, capture) if checkpoint.exists() else State.of(start)
    while state.adam.steps < capture.first_steps:
        step = state.adam.steps
        # numbers that depend on the step alone: a run that was interrupted draws the same ones
        rng = np.random.default_rng([capture.seed, STEP_STREAM, step])
        loss = one_step(state, capture, views[rng.integers(len(views))])
        change_number(state, capture, rng)
        if progress is not None:
            progress(step, loss, state.cloud.num_gaussians)
        if state.adam.steps % SAVE_EVERY == 0:
            save(checkpoint, state, capture)
    return state.cloud


def one_step(state: State, capture: Capture, view: View) -> float:
    """One step of Adam towards a view; returns the loss before it."""
    adam = state.adam
    loss, gradient = loss_gradient(state.cloud, view)
    state.pull.add(adam.values["positions"], gradient, view.camera)
    progress = adam.steps / capture.first_steps
    rate = capture.rig.distance * decayed(*POSITION_RATES, progress)
    adam.step(gradient._asdict(), {"positions": rate, **RATES})
    return loss


def change_number(state: State, capture: Capture, rng: np.random.Generator) -> None:
    """Densify and reset opacities where the step says so."""
    step, last = state.adam.steps, round(DENSIFY_UNTIL * capture.first_steps)
    if not DENSIFY_FROM <= step <= last:
        return
    if step % DENSIFY_EVERY == 0:
        densify(state.adam, state.pull, capture.rig.distance, capture.most, rng)
        state.pull = Pull.none(state.cloud.num_gaussians)
    # not at the very end of densification: what is faint could not be pruned any more
    if step % RESET_EVERY == 0 and step + RESET_EVERY // 2 <= last:
        reset_opacities(state.adam)


def save(path: Path, state: State, capture: Capture) -> None:
    """Write a checkpoint; an interruption leaves the last one as it was."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".tmp")
    about = np.array(json.dumps(asdict(capture)))
    with partial.open("wb") as file:
        np.savez(
            file,
            capture=about,
            pull_total=state.pull.total,
            pull_count=state.pull.count,
            **state.adam.arrays(),
        )
    os.replace(partial, path)


def load(path: Path, capture: Capture) -> State:
    """Read a checkpoint; raises InputError for one of another capture or of other settings."""
    with np.load(path) as stored:
        arrays = dict(stored)
    if str(arrays.pop("capture")) != json.dumps(asdict(capture)):
        raise InputError(f"{path} was made with other settings; remove it or choose another folder")
    pull = Pull(arrays.pop("pull_total"), arrays.pop("pull_count"))
    return State(Adam.from_arrays(arrays), pull)
