"""The cameras of the evaluation: `views.json` freezes eight per scene.

`python -m lab.views` adds those of scenes that have none yet.

Each camera looks at the middle of the box that holds the central 98 % of the first frame's Gaussians along
every axis, from a distance at which the box fills 80 % of the image's height (or of its width, where the box
is wider than the image's shape). A capture is seen from between the cameras that it was fitted to, in images
of their size and angle.
"""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Float64
from dfcgs_codec.gaussians import GaussianCloud
from lab.assets import find_asset, has_asset
from lab.render.camera import Camera, look_at, orbit
from lab.scenes.catalogue import Scene, group

VIEWS = Path(__file__).with_name("views.json")
SIZE = (640, 480)
VERTICAL_FOV = 50.0
FILL = 0.8
#: azimuth and elevation of each view, degrees
ANGLES = tuple((45.0 * i, (10.0, 35.0)[i % 2]) for i in range(8))
#: which of the eight a short benchmark renders
FEW = (0, 3, 6)
_UP = {"+y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0)}


def central_box(cloud: GaussianCloud) -> Float64:
    """(2, 3) lower and upper corner around the central 98 % along each axis."""
    return np.percentile(cloud.positions.astype(np.float64), [1.0, 99.0], axis=0)


def _fill(camera: Camera, corners: Float64) -> float:
    """Share of the image that the corners (8, 3) span; infinite where one is not before the camera."""
    seen = corners @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    if seen[:, 2].min() <= 0.0:
        return np.inf
    across = np.ptp(camera.fx * seen[:, 0] / seen[:, 2]) / camera.width
    upright = np.ptp(camera.fy * seen[:, 1] / seen[:, 2]) / camera.height
    return float(max(across, upright))


def framing_camera(box: Float64, angles: tuple[float, float], up: str) -> Camera:
    """The camera in that direction at which the box fills FILL of the image."""
    middle, size = box.mean(axis=0), float(np.linalg.norm(box[1] - box[0])) or 1.0
    corners = np.array(list(product(*box.T)))
    near, far = 0.0, 100.0 * size
    for _ in range(60):
        distance = 0.5 * (near + far)
        camera = orbit(middle.tolist(), distance, angles, SIZE, VERTICAL_FOV, up=_UP[up])
        near, far = (distance, far) if _fill(camera, corners) > FILL else (near, distance)
    return camera


def _entry(camera: Camera, middle: Float64, up: str) -> dict[str, Any]:
    return {
        "eye": np.round(camera.position, 6).tolist(),
        "target": np.round(middle, 6).tolist(),
        "up": _UP[up],
    }


def scene_views(cloud: GaussianCloud, up: str) -> list[dict[str, Any]]:
    """Eight views of a first frame, as `views.json` has them."""
    box = central_box(cloud)
    return [_entry(framing_camera(box, angles, up), box.mean(axis=0), up) for angles in ANGLES]


def capture_views(name: str) -> list[dict[str, Any]]:
    """Eight views of a capture, as `views.json` has them; needs numba."""
    from lab.captures.captures import CAPTURES
    from lab.captures.rigs import SIZE as CAPTURE_SIZE
    from lab.captures.rigs import evaluation_cameras

    rig = CAPTURES[name].rig
    lens = {"size": CAPTURE_SIZE, "vertical_fov_degrees": rig.vertical_fov}
    entries = []
    for camera in evaluation_cameras(rig):
        target = camera.position + rig.distance * camera.world_to_camera[2, :3]
        entries.append(_entry(camera, target, "+y") | lens)
    return entries


def cameras(scene: str, views: tuple[int, ...] = tuple(range(len(ANGLES)))) -> list[Camera]:
    """The frozen cameras of a scene."""
    entries = json.loads(VIEWS.read_text())["scenes"][scene]
    return [_camera(entries[i]) for i in views]


def _camera(entry: dict[str, Any]) -> Camera:
    size, fov = tuple(entry.get("size", SIZE)), entry.get("vertical_fov_degrees", VERTICAL_FOV)
    return look_at(entry["eye"], entry["target"], size, fov, entry["up"])


def _first_frame(scene: Scene) -> GaussianCloud:
    return next(iter(scene.frames(find_asset(scene.asset))))


def main() -> None:
    """Add the views of scenes that have none yet; what is there stays."""
    known: dict[str, Any] = json.loads(VIEWS.read_text())["scenes"] if VIEWS.exists() else {}
    for scene in [*group("evaluation"), *group("long")]:
        if scene.name not in known and has_asset(scene.asset):
            known[scene.name] = scene_views(_first_frame(scene), scene.up)
            print(scene.name)
    for scene in group("captures"):
        if scene.name not in known:
            known[scene.name] = capture_views(Path(scene.asset).stem)
            print(scene.name)
    lines = [f'  "{name}": {json.dumps(views)}' for name, views in known.items()]
    head = f'{{\n "size": {list(SIZE)},\n "vertical_fov_degrees": {VERTICAL_FOV},\n "scenes": {{\n'
    VIEWS.write_text(head + ",\n".join(lines) + "\n }\n}\n")


if __name__ == "__main__":
    main()
