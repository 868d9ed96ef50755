"""The frozen list of scenes: the sequences of training and evaluation, and every parameter of the generator.

`catalogue.json` holds it. `evaluation` (never trained on), `long` (300 frames, evaluation too) and `training`
are objects seen from outside; `captures` (evaluation) and `captures_training` are rooms seen from where the
cameras stood (`training.captures`). Rooms, characters and clips of what is evaluated do not occur in what is
trained on; trained splats never do.
A change of the file is a change of every figure that was measured with it: a test pins its digest.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply
from lab.scenes.animated import animated_sequence
from lab.scenes.fitted import fitted_sequence
from lab.scenes.options import SceneOptions
from lab.scenes.semi_tracked import semi_tracked_with_ids
from lab.scenes.trained import trained_sequence
from lab.scenes.variants import VARIANTS, permuted_with_ids

CATALOGUE = Path(__file__).with_name("catalogue.json")
Group = Literal["evaluation", "long", "training", "captures", "captures_training"]
GROUPS: tuple[Group, ...] = ("evaluation", "long", "training", "captures", "captures_training")
#: the modules whose constants make a scene what it is
_MODULES = (
    "scenes.animated",
    "meshes.appearance",
    "scenes.fields",
    "meshes.posing",
    "scenes.semi_tracked",
    "scenes.stress",
    "scenes.tracked",
    "scenes.trained",
)
#: identities of a scene whose index is not the identity
_WITH_IDS = {"semi": semi_tracked_with_ids, "permuted": permuted_with_ids}


@dataclass(frozen=True)
class Scene:
    """One sequence of the list.

    asset is a file name; clip belongs to glTF assets, motion to static splats, neither to fitted sequences.
    num_gaussians and sh_degree None: those of the asset. up: the direction away from the ground.
    """

    name: str
    group: Group
    asset: str
    clip: str | None
    motion: str | None
    variant: str
    num_frames: int
    num_gaussians: int | None
    sh_degree: int | None
    seed: int
    fps: float
    up: Literal["+y", "-y"]

    @property
    def options(self) -> SceneOptions:
        """For the generator."""
        return SceneOptions(self.num_frames, self.num_gaussians, self.sh_degree, self.seed, self.fps)

    def _clean(self, asset: Path) -> Iterator[GaussianCloud]:
        if self.clip is not None:
            return animated_sequence(asset, self.options, self.clip)
        if self.motion is not None:
            return trained_sequence(read_ply(asset)[0], self.options, self.motion)
        return fitted_sequence(asset)

    def frames(self, asset: Path) -> Iterator[GaussianCloud]:
        """The frames, made from the file `asset`."""
        return VARIANTS[self.variant](self._clean(asset), self.seed)

    def frames_with_ids(self, asset: Path) -> Iterator[tuple[GaussianCloud, Int64 | None]]:
        """The frames and their true identities (N,); None where the index is the identity or nothing is."""
        if self.variant in _WITH_IDS:
            yield from _WITH_IDS[self.variant](self._clean(asset), self.seed)
        else:
            for frame in self.frames(asset):
                yield frame, None


@cache
def scenes() -> dict[str, Scene]:
    """All scenes by name, in the order of the list."""
    listed = json.loads(CATALOGUE.read_text())
    return {name: Scene(name, group, **entry) for group in GROUPS for name, entry in listed[group].items()}


def scene(name: str) -> Scene:
    """The scene of that name; raises InputError with the names there are."""
    if name not in scenes():
        raise InputError(f"no scene {name!r}; there are {', '.join(scenes())}")
    return scenes()[name]


def group(name: Group) -> list[Scene]:
    """The scenes of a group."""
    return [s for s in scenes().values() if s.group == name]


def is_capture(name: str) -> bool:
    """Whether `name` is a scene that fills the images of its views; one that is not in the list is none."""
    return name in scenes() and scenes()[name].group in ("captures", "captures_training")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


def _is_parameter(name: str, value: object) -> bool:
    return name.isupper() and isinstance(value, int | float | tuple | np.ndarray)


def generator_parameters() -> dict[str, Any]:
    """Every constant and default of the generator as it stands in the code, `module.NAME` -> value."""
    found: dict[str, Any] = {}
    for path in _MODULES:
        module, short = importlib.import_module(f"lab.{path}"), path.rpartition(".")[2]
        for name, value in vars(module).items():
            if _is_parameter(name, value):
                found[f"{short}.{name}"] = _plain(value)
            elif dataclasses.is_dataclass(value) and value.__module__ == module.__name__:
                found |= _defaults(f"{short}.{name}", value)
    return dict(sorted(found.items()))


def _defaults(prefix: str, kind: Callable[..., Any]) -> dict[str, Any]:
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    return {f"{prefix}.{f.name}": _plain(f.default) for f in fields if f.default is not dataclasses.MISSING}
