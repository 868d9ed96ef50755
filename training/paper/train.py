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

from dfcgs_codec.errors import InputError
from training.paper.config import STAGES, Config
from training.paper.data import Data
from training.paper.nets import ABLATIONS, PaperModel
from training.paper.objectives import geometry, rendering
from training.paper.warm_up import warm_up_loss

CHECKPOINT, CURVES, TABLE = "checkpoint.pt", "curves.json", "curves.csv"
#: iterations between two rows of the curves, and between two checkpoints
ROW_EVERY, SAVE_EVERY = 50, 200
_LARGEST_GRADIENT = 5.0


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
        objective = geometry if stage == "geometry" else rendering
        loss, notes = objective(run.model, run.config, data, rng)
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
