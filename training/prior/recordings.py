"""Recordings: what the prior is told in real streams, and the symbols that then came.

Scenes are encoded with a prior and decoded with one that looks on: a recording is what a decoder sees.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.codec.columns.prior_column import Component
from dfcgs_codec.codec.motion.control_points import ControlPrior
from dfcgs_codec.codec.residual.walk import PriorContext
from dfcgs_codec.model.context_model import ContextModel, Flags, Part
from dfcgs_codec.model.registry import register

#: frames of a recorded GoF
NUM_FRAMES = 10
#: symbols kept of one part of one stream
MOST_SYMBOLS = 30_000
#: id of the prior while recordings are made
RECORDED = "recorded"


@dataclass
class Recording:
    """By name of a part of the model, arrays of one row a symbol.

    `inputs` uint8, `cells` int8 (kind, fraction), `values` int32, `stream` int32: which stream it was.
    """

    parts: dict[str, dict[str, list[AnyArray]]] = field(default_factory=dict)
    stream: int = 0

    def add(self, name: str, **arrays: AnyArray) -> None:
        """More rows of a part."""
        known = self.parts.setdefault(name, {})
        for key, array in arrays.items():
            known.setdefault(key, []).append(array)

    def save(self, path: Path) -> None:
        """Write what was recorded."""
        path.parent.mkdir(parents=True, exist_ok=True)
        flat = {f"{n}.{k}": np.concatenate(v) for n, part in self.parts.items() for k, v in part.items()}
        np.savez(path, **flat)  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Looker:
    """Stands for a part: remembers what it is asked and what came of it."""

    name: str
    part: Part | Flags
    recording: Recording
    rng: np.random.Generator

    def prepare(self, common: AnyArray) -> tuple[AnyArray, AnyArray]:
        """The part's own sums, and the inputs themselves, row by row."""
        return _Prepared(self.part.prepare(common), common)  # type: ignore[return-value]

    def code(self, coder: Any, values: Any, inputs: Any, cells: Any = None) -> Any:
        """As the part does."""
        prepared, others = inputs
        given = (prepared.sums, others)
        found = (
            self.part.code(coder, values, given)  # type: ignore[call-arg]
            if cells is None
            else self.part.code(coder, values, given, cells)
        )
        rows = np.arange(len(found))
        if len(rows) > MOST_SYMBOLS:
            rows = self.rng.choice(rows, MOST_SYMBOLS, replace=False)
        told = np.concatenate([prepared.common[rows], others[rows]], axis=1)
        pair = np.zeros((len(rows), 2), np.int8) if cells is None else np.stack(cells, axis=1)[rows]
        self.recording.add(
            self.name,
            inputs=told,
            cells=pair.astype(np.int8),
            values=np.clip(found[rows], -(1 << 30), 1 << 30).astype(np.int32),
            stream=np.full(len(rows), self.recording.stream, np.int32),
        )
        return found


@dataclass(frozen=True)
class _Prepared:
    """Sums with the inputs that made them; rows are taken of both."""

    sums: AnyArray
    common: AnyArray

    def __getitem__(self, rows: Any) -> _Prepared:
        return _Prepared(self.sums[rows], self.common[rows])


@contextmanager
def _classes_recorded(recording: Recording) -> Iterator[None]:
    """Also remember block classes with their contexts, and what control points are predicted from."""
    from dfcgs_codec.codec.residual import walk as inter

    density, magnitude, column = inter._code_density, inter._code_magnitude, Component.code

    def code_density(coder: Any, given: Any, context: PriorContext) -> Any:
        found = density(coder, given, context)
        recording.stream += 1
        contexts = context.before.density * 4 + context.beside
        recording.add("densities", contexts=contexts.astype(np.int8), values=found.astype(np.int8))
        return found

    def code_magnitude(coder: Any, given: Any, classes: Any, context: PriorContext) -> Any:
        found = magnitude(coder, given, classes, context)
        rows = np.flatnonzero(classes > 0)
        before = context.before.magnitude[rows]
        contexts = classes[rows] + 4 * (before > 0)
        recording.add("magnitudes", contexts=contexts.astype(np.int8), values=(found[rows] - before))
        return found

    code_control = ControlPrior.code

    def code_points(self: ControlPrior, coder: Any, target: Any, *args: Any) -> Any:
        recording.stream += 1
        columns = iter(range(6))

        def code(component: Component, coder: Any, given: Any, lod: Any, weights: Any) -> Any:
            values, residual = column(component, coder, given, lod, weights)
            features, goal = component.evidence(values, lod)
            index = next(columns)
            table = np.zeros((len(goal), 8), np.float32)
            table[:, : index + 1] = np.stack(features[: index + 1], axis=1)
            table[:, 6:] = np.stack(features[index + 1 :], axis=1)
            stream = np.full(len(goal), recording.stream, np.int32)
            recording.add(f"control_{index}", features=table, values=goal.astype(np.int32), stream=stream)
            return values, residual

        with mock.patch.object(Component, "code", code):
            return code_control(self, coder, target, *args)

    with (
        mock.patch.object(inter, "_code_density", code_density),
        mock.patch.object(inter, "_code_magnitude", code_magnitude),
        mock.patch.object(ControlPrior, "code", code_points),
    ):
        yield


def record(frames: list[GaussianCloud], qp: float, model: ContextModel, seed: int) -> Recording:
    """One GoF of `frames` coded with the prior `model`, whose id must be RECORDED."""
    recording, rng = Recording(), np.random.default_rng(seed)
    looking = replace(
        model,
        flags=_Looker("flags", model.flags, recording, rng),
        columns=_Looker("columns", model.columns, recording, rng),
        control=_Looker("control", model.control, recording, rng),
    )
    options = EncoderOptions(qp=qp, gof_size=len(frames), tuning=EncoderTuning(model_id=RECORDED))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gof.dgs"
        register(model)
        encode_sequence(frames, path, options)
        register(looking)
        with _classes_recorded(recording):
            for _ in islice(decode_sequence(path), len(frames)):
                pass
    return recording
