"""The moving sequences of the first benchmarks, made by the generator; frozen by name."""

from __future__ import annotations

from collections.abc import Callable

from dfcgs_codec import GaussianCloud
from dfcgs_codec.ply import read_ply
from lab.assets import find_asset
from lab.scenes import VARIANTS, SceneOptions, animated_sequence, trained_sequence

_FRAMES = 20


def _tracked_splat() -> list[GaussianCloud]:
    """A trained splat: a part turns, the rest changes as 3DGStream's output does."""
    cloud, _ = read_ply(find_asset("playbot_125k_sh2.ply", "playbot_31k_sh2.ply"))
    clean = trained_sequence(cloud, SceneOptions(_FRAMES), "part")
    return list(VARIANTS["noisy"](clean, 0))


def _animated_character() -> list[GaussianCloud]:
    """50 000 Gaussians on a walking character; positions and rotations move, the rest is constant."""
    return list(animated_sequence(find_asset("Knight.glb"), SceneOptions(_FRAMES, 50_000, 1), "Walking_A"))


def _all_change() -> list[GaussianCloud]:
    """A trained splat that sways while every attribute of every Gaussian drifts."""
    cloud, _ = read_ply(find_asset("playbot_31k_sh2.ply"))
    clean = trained_sequence(cloud, SceneOptions(_FRAMES), "sway")
    return list(VARIANTS["drift"](clean, 0))


BENCHMARK_SCENES: dict[str, Callable[[], list[GaussianCloud]]] = {
    "tracked_splat": _tracked_splat,
    "animated_character": _animated_character,
    "all_attributes_change": _all_change,
}


def make_scene(name: str) -> list[GaussianCloud]:
    """The frames of a benchmark scene."""
    return BENCHMARK_SCENES[name]()
