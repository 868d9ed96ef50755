"""The frozen list of scenes."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.errors import InputError
from lab.scenes import MOTIONS, VARIANTS
from lab.scenes.catalogue import CATALOGUE, Scene, generator_parameters, group, scene, scenes
from lab.scenes.fitted import read_about

#: a change of the list is a change of every figure measured with it: measure again, then change this
DIGEST = "347ece5dcbe8375909acedeef02e9fe23391eb5cc3fb2ff6eb4cc08d4e4a6593"
ASSETS = Path(__file__).resolve().parents[2] / "assets"


def test_the_list_is_frozen() -> None:
    assert hashlib.sha256(CATALOGUE.read_bytes()).hexdigest() == DIGEST


def test_the_generator_has_the_listed_parameters() -> None:
    listed = json.loads(CATALOGUE.read_text())["generator"]
    found = generator_parameters()
    assert found.keys() == listed.keys()
    for name, value in listed.items():
        assert found[name] == pytest.approx(value, rel=1e-12), name


def test_there_are_scenes_enough() -> None:
    assert len(group("evaluation")) >= 8
    assert {s.variant for s in group("evaluation")} >= {
        "smooth",
        "noisy",
        "drift",
        "semi",
        "permuted",
        "untracked",
    }
    assert all(s.num_frames == 300 for s in group("long"))


JUDGED, TRAINED = ("evaluation", "long", "captures"), ("training", "captures_training")


def made_of(entry: Scene) -> dict[str, str | None]:
    """Character, clip and room of a scene; a stored one names those that it was fitted to."""
    if not entry.asset.endswith(".zip"):
        return {"character": entry.asset.split(".")[0].lower(), "clip": entry.clip, "room": None}
    source = read_about(ASSETS / "fitted" / entry.asset)["source"]
    actor = source.get("actor", source)
    character = actor["asset"].split(".")[0].split("_")[0].lower()
    return {"character": character, "clip": actor["clip"], "room": source.get("room")}


@pytest.mark.parametrize("kind", ["character", "clip", "room"])
def test_training_and_evaluation_share_no_character_no_clip_and_no_room(kind: str) -> None:
    judged, trained = (
        {made_of(s)[kind] for name in names for s in group(name)} - {None} for names in (JUDGED, TRAINED)
    )
    assert not judged & trained


def test_a_capture_has_its_cameras_beside_it() -> None:
    for entry in [*group("captures"), *group("captures_training")]:
        cameras = json.loads((ASSETS / "fitted" / Path(entry.asset).stem / "cameras.json").read_text())
        assert 20 <= len(cameras) <= 32


def test_trained_splats_are_for_evaluation_only() -> None:
    assert all(s.motion is None for s in group("training"))


@pytest.mark.parametrize("name", list(scenes()))
def test_entries_make_sense(name: str) -> None:
    entry = scene(name)
    assert entry.variant in VARIANTS
    assert entry.motion is None or entry.motion in MOTIONS
    assert not (entry.motion and entry.clip)
    assert entry.options.num_frames == entry.num_frames


def test_retraining_needs_nothing_but_the_repository() -> None:
    trained_on = [*group("training"), *group("captures_training")]
    missing = [s.asset for s in trained_on if not any(ASSETS.rglob(s.asset))]
    assert not missing


def test_frames_follow_from_the_list() -> None:
    entry = scene("playbot_twist_permuted")
    frames = list(zip(range(2), entry.frames_with_ids(ASSETS / entry.asset), strict=False))
    (first, first_ids), (_, second_ids) = (frame for _, frame in frames)
    assert first.num_gaussians == len(first_ids)
    assert not np.array_equal(first_ids, second_ids)
    assert len(np.intersect1d(first_ids, second_ids)) > 0.98 * len(first_ids)


def test_an_unknown_scene_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match="knight_walk"):
        scene("night_walk")
