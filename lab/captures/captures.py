"""The captures by name, and the images of their true frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lab.captures.mesh import Actor, actor_meshes, room_mesh
from lab.captures.picture import image, layer
from lab.captures.rigs import Rig
from lab.captures.rooms import ROOMS
from lab.render import Camera, View

#: as 3DGS trains: what is bright far away must be explained by Gaussians
BACKGROUND = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Capture:
    """A room, who moves in it, the cameras, and how it is fitted.

    start: random Gaussians at the beginning; most: how many there may be in the end.
    first_steps, later_steps: steps of Adam in frame 0 and in each later one.
    """

    group: Literal["captures", "captures_training"]
    room: str
    actor: Actor
    rig: Rig
    sh_degree: int = 0
    start: int = 15_000
    most: int = 30_000
    seed: int = 0
    first_steps: int = 5000
    later_steps: int = 200


CAPTURES: dict[str, Capture] = {
    "capture_kitchen": Capture(
        "captures",
        "kitchen",
        Actor("mage_interact.glb", "Interact", place=(-0.4, 0.0, 0.2)),
        Rig("forward", (0.3, 2.6, 7.5), (0.0, 1.3, -1.5), 45.0),
        sh_degree=1,
        most=32_000,
    ),
    "capture_living_room": Capture(
        "captures",
        "living_room",
        Actor("Knight.glb", "Use_Item", fps=60.0, place=(-0.3, 0.0, 0.1), turn=30.0, size=1.9),
        Rig("inside", (3.1, 1.9, 0.0), (0.0, 1.2, 0.0), 62.0),
        seed=1,
    ),
    "capture_dungeon": Capture(
        "captures",
        "dungeon",
        Actor("lumberjack_walk.glb", "Walk", place=(0.4, 0.0, 0.0), turn=-20.0, size=2.3),
        Rig("forward", (-0.4, 2.3, 7.8), (0.0, 1.4, -1.5), 45.0),
        seed=2,
    ),
    "capture_bedroom": Capture(
        "captures_training",
        "bedroom",
        Actor("Barbarian.glb", "Block_Attack", place=(0.3, 0.1, 0.2), fps=60.0),
        Rig("forward", (-0.3, 2.4, 7.4), (0.0, 1.4, -1.2), 42.0),
        seed=3,
    ),
    "capture_street": Capture(
        "captures_training",
        "street",
        Actor("Rogue.glb", "1H_Ranged_Reload", turn=60.0),
        Rig("forward", (0.4, 2.5, 9.0), (0.0, 1.4, -1.5), 48.0),
        seed=4,
    ),
}


def true_views(capture: Capture, cameras: list[Camera], num_frames: int) -> Iterator[list[View]]:
    """What the cameras see, frame after frame."""
    room = ROOMS[capture.room]
    still = room_mesh(room)
    empty = [layer(still, room, camera) for camera in cameras]
    for moving in actor_meshes(capture.actor, num_frames):
        full = (layer(moving, room, camera, behind) for camera, behind in zip(cameras, empty, strict=True))
        yield [View(camera, image(seen), BACKGROUND) for camera, seen in zip(cameras, full, strict=True)]
