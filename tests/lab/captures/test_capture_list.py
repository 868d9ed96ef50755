"""The captures that there are: what is in them, and that training and evaluation share nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from lab.captures.captures import CAPTURES, Capture
from lab.captures.mesh import actor_path
from lab.captures.rooms import ROOMS


class TestCaptures:
    def test_training_and_evaluation_share_nothing(self) -> None:
        for kind in ("room", "actor.asset", "actor.clip"):
            seen = {
                group: {value(c, kind) for c in CAPTURES.values() if c.group == group} for group in GROUPS
            }
            assert not seen["captures"] & seen["captures_training"], kind

    @pytest.mark.parametrize("name", CAPTURES)
    def test_the_clip_is_there_and_the_room_too(self, name: str) -> None:
        capture = CAPTURES[name]
        assert capture.actor.clip in clips(actor_path(capture.actor.asset))
        assert capture.room in ROOMS

    def test_there_are_three_to_judge_by_and_two_to_train_on(self) -> None:
        kinds = [(c.group, c.rig.kind) for c in CAPTURES.values()]
        assert [kinds.count(("captures", kind)) for kind in ("forward", "inside")] == [2, 1]
        assert len([group for group, _ in kinds if group == "captures_training"]) == 2


GROUPS = ("captures", "captures_training")


def clips(path: Path) -> list[str]:
    """Names of a GLB's clips, from its JSON chunk: to read all their keys takes seconds."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    return [clip["name"] for clip in json.loads(data[20 : 20 + length])["animations"]]


def value(capture: Capture, kind: str) -> str:
    found: object = capture
    for part in kind.split("."):
        found = getattr(found, part)
    return str(found)
