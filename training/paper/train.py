"""The training loop: three stages, checkpoints that resume to the same result, curves."""

from __future__ import annotations

import csv
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dfcgs_codec.errors import InputError
from training.paper.coding import closed_loop
from training.paper.config import HELD_BACK, STAGES, STEPS, Config
from training.paper.gof import Gof
from training.paper.losses import ROTATION_WEIGHT, frame_costs, geometry_loss
from training.paper.nets import ABLATIONS, PaperModel
from training.paper.samples import Sample, augmented, joined, sample_of
from training.paper.warm_up import warm_up_loss

CHECKPOINT, CURVES, TABLE = "checkpoint.pt", "curves.json", "curves.csv"
#: iterations between two rows of the curves, and between two checkpoints
ROW_EVERY, SAVE_EVERY = 50, 200
_LARGEST_GRADIENT = 5.0
#: of the geometry's distortion beside the relative render loss
GEOMETRY_SHARE = 0.5
#: render losses below this count little
RENDER_FLOOR = 1e-3


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


@dataclass
class Run:
    """The state of a run; `rows` are those of the curves, `start` says which checkpoint it began from."""

    config: Config
    model: PaperModel
    optimiser: torch.optim.Adam
    done: int = 0
    seconds: float = 0.0
    rows: list[dict[str, Any]] = field(default_factory=list)
    start: str = ""

    @staticmethod
    def new(config: Config) -> Run:
        """At the beginning."""
        torch.manual_seed(config.seed)
        model = PaperModel(frozenset(config.without))
        return Run(config, model, torch.optim.Adam(model.parameters()))

    @staticmethod
    def fine_tune(checkpoint: Path, config: Config) -> Run:
        """From the networks of another run, but for those left out."""
        saved = torch.load(checkpoint, weights_only=False)
        run = Run.new(config)
        kept = run.model.state_dict().keys()
        run.model.load_state_dict({k: v for k, v in saved["model"].items() if k in kept})
        run.start = f"fine-tuned after {saved['done']} iterations"
        return run

    @staticmethod
    def load(path: Path) -> Run:
        """What `save` wrote."""
        saved = torch.load(path, weights_only=False)
        run = Run.new(Config(**saved["config"]))
        run.model.load_state_dict(saved["model"])
        run.optimiser.load_state_dict(saved["optimiser"])
        run.done, run.seconds, run.rows, run.start = (saved[k] for k in ("done", "seconds", "rows", "start"))
        return run

    def save(self, folder: Path) -> None:
        """Checkpoint and curves, each under its name only when whole."""
        saved = {
            "config": self.config.as_dict(),
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "done": self.done,
            "seconds": self.seconds,
            "rows": self.rows,
            "start": self.start,
        }
        _replace(folder / CHECKPOINT, lambda path: torch.save(saved, path))
        about = {"config": self.config.as_dict(), "seconds": round(self.seconds, 1), "rows": self.rows}
        _replace(folder / CURVES, lambda path: path.write_text(json.dumps(about, indent=1) + "\n"))
        _replace(folder / TABLE, self._write_table)

    def _write_table(self, path: Path) -> None:
        columns = list(dict.fromkeys(key for row in self.rows for key in row))
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(self.rows)


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    partial = path.with_name(path.name + ".tmp")
    write(partial)
    os.replace(partial, path)


def _draw_steps(count: int, rng: np.random.Generator) -> Tensor:
    return torch.from_numpy(2.0 ** rng.choice(STEPS, count)).float()


def _geometry(run: Run, data: Data, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
    """Loss of a batch of GoFs, and what is noted of it."""
    batch = data.batch(run.config.batch, rng)
    step = _draw_steps(batch.num_groups, rng)
    losses, notes = [], []
    for frame, reference, coded in closed_loop(run.model, batch, step):
        costs = frame_costs(batch, frame, reference, coded)
        losses.append(geometry_loss(costs, step, run.config.rate_weight))
        values = (costs.position_ratio, costs.rotation_ratio, costs.motion_bits, costs.hyper_bits)
        notes.append([float(value.detach().mean()) for value in values])
    names = ("position_ratio", "rotation_ratio", "motion_bits", "hyper_bits")
    return torch.stack(losses).mean(), dict(zip(names, np.mean(notes, axis=0).tolist(), strict=True))


def _rendering(run: Run, data: Data, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
    """The same of one GoF with pictures of one camera."""
    # the renderer is compiled by numba; the stages before do without
    from training.paper.rendering import Stage, rendered_loop

    gof = data.gof(rng)
    stage, view = Stage.of(gof), int(rng.integers(len(gof.images)))
    step = _draw_steps(1, rng)
    losses, notes = [], []
    for frame, rendered in rendered_loop(run.model, stage, step, view):
        costs = frame_costs(stage.sample, frame, rendered.reference, rendered.coded)
        relative = rendered.loss / (rendered.repeated + RENDER_FLOOR)
        distortion = costs.position_ratio + ROTATION_WEIGHT * costs.rotation_ratio
        rate = run.config.rate_weight * step.square() * costs.bits
        losses.append(((relative + GEOMETRY_SHARE * distortion + rate) / step).mean())
        values = (relative, rendered.unrefined / (rendered.repeated + RENDER_FLOOR), costs.position_ratio)
        rates = (costs.motion_bits, costs.hyper_bits)
        notes.append([float(value.detach().mean()) for value in (*values, *rates)])
    names = ("render_ratio", "unrefined_ratio", "position_ratio", "motion_bits", "hyper_bits")
    return torch.stack(losses).mean(), dict(zip(names, np.mean(notes, axis=0).tolist(), strict=True))


def _step(run: Run, data: Data) -> dict[str, Any]:
    """One iteration; its draws depend on the seed and its number alone."""
    stage, iteration = run.config.at(run.done)
    rng = np.random.default_rng((run.config.seed, STAGES.index(stage), iteration))
    torch.manual_seed(int(rng.integers(1 << 62)))
    if iteration == 0:
        run.optimiser = torch.optim.Adam(run.model.parameters())
    for settings in run.optimiser.param_groups:
        settings["lr"] = run.config.learning_rate(stage, iteration)
    notes: dict[str, float] = {}
    run.model.train()
    if stage == "warm_up":
        loss = warm_up_loss(run.model)
    else:
        loss, notes = (_geometry if stage == "geometry" else _rendering)(run, data, rng)
    run.optimiser.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(run.model.parameters(), _LARGEST_GRADIENT)
    run.optimiser.step()
    run.done += 1
    return {"stage": stage, "loss": float(loss.detach()), **notes}


def _row(run: Run, recent: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians of the last iterations of one stage."""
    same = [notes for notes in recent if notes["stage"] == recent[-1]["stage"]]
    row: dict[str, Any] = {
        "iteration": run.done,
        "stage": recent[-1]["stage"],
        "seconds": round(run.seconds, 1),
    }
    for name in same[-1]:
        if name != "stage":
            row[name] = round(float(np.median([notes[name] for notes in same])), 5)
    return row


def train(
    run: Run,
    data: Data,
    folder: Path | None = None,
    report: Callable[[dict[str, Any]], None] | None = None,
    stop: int | None = None,
) -> Run:
    """Go on to the end, or to iteration `stop`; with a `folder`, checkpoints on the way and at the end."""
    end = run.config.total if stop is None else min(stop, run.config.total)
    recent: list[dict[str, Any]] = []
    begun, before = time.perf_counter(), run.seconds
    while run.done < end:
        recent.append(_step(run, data))
        run.seconds = before + time.perf_counter() - begun
        if run.done % ROW_EVERY == 0 or run.done == run.config.total:
            run.rows.append(_row(run, recent))
            recent = []
            if report is not None:
                report(run.rows[-1])
        if folder is not None and run.done % SAVE_EVERY == 0:
            run.save(folder)
    if folder is not None:
        run.save(folder)
    return run


def config_of_minutes(config: Config, data: Data, minutes: float, shares: dict[str, float]) -> Config:
    """Iterations that take about so long, of the stages by their shares, from the time that a few take."""
    counts = {}
    for stage in STAGES:
        if stage not in shares:
            counts[stage] = 0
            continue
        trial = Run.new(replace(config, **{s: 3 if s == stage else 0 for s in STAGES}))
        _step(trial, data)
        begun = time.perf_counter()
        for _ in range(2):
            _step(trial, data)
        each = (time.perf_counter() - begun) / 2
        counts[stage] = max(1, int(minutes * 60 * shares[stage] / each))
    return replace(config, **counts)


def check_ablations(names: list[str]) -> tuple[str, ...]:
    """Sorted; InputError for what cannot be left out."""
    for name in names:
        if name not in ABLATIONS:
            raise InputError(f"cannot leave out {name!r}; expected one of {', '.join(ABLATIONS)}")
    return tuple(sorted(set(names)))
