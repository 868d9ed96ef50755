"""Put a static, trained splat in motion.

A motion maps points to points; rotations follow from it (the rotation part of its Jacobian), so that every
Gaussian turns exactly as its surroundings do. Frame 0 is the splat at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.scenes import rotations
from lab.scenes.fields import field_for, scene_size
from lab.scenes.options import SceneOptions, reduce_cloud

#: the direction away from the ground in captured splats (COLMAP's y axis points down)
UP = np.array([0.0, -1.0, 0.0])
#: seconds of one swing or turn
PERIOD = 3.0
#: largest angle of a bend or twist, radians, and typical sway as a share of the height
ANGLE = 0.5
SWAY = 0.05
#: the rigid part: share of the Gaussians, and how far it travels as a share of the scene's size
PART_SHARE = 0.12
PART_TRAVEL = 0.15
#: keeps the random numbers of a motion apart from those of other stages with the same seed
MOTION_STREAM = 1
#: step of the finite differences, share of the scene's size: rounding and curvature stay below 1e-7
DIFFERENCE = 1e-5

PointMap = Callable[[Float64, float], Float64]


@dataclass(frozen=True)
class Motion:
    """`move` takes the rest positions (n, 3) of the Gaussians `index` (n,), and seconds.

    It gives their new positions (n, 3) and the rotations (n, 4) to put before their own.
    """

    index: Int64
    move: Callable[[Float64, float], tuple[Float64, Float64]]


@dataclass(frozen=True)
class _Stage:
    """Where a scene stands: heights above `base` along UP, up to `height`; `side` is horizontal."""

    base: Float64
    height: float
    side: Float64

    def heights(self, points: Float64) -> Float64:
        return (points - self.base) @ UP


def _stage(cloud: GaussianCloud, rng: np.random.Generator) -> _Stage:
    points = cloud.positions.astype(np.float64)
    low, high = np.percentile(points @ UP, [1.0, 99.0])
    middle = np.median(points, axis=0)
    side = np.cross(UP, rng.standard_normal(3))
    height = float(high - low)
    base = middle + (low - middle @ UP) * UP
    return _Stage(base, height if height > 0.0 else 1.0, side / np.linalg.norm(side))


def _swing(time: float) -> float:
    """-1 to 1, 0 at the start."""
    return float(np.sin(2.0 * np.pi * time / PERIOD))


def jacobians(point_map: PointMap, points: Float64, time: float, step: float) -> Float64:
    """(N, 3, 3) derivatives of a point map by central differences."""
    columns = [point_map(points + d, time) - point_map(points - d, time) for d in step * np.eye(3)]
    return np.stack(columns, axis=2) / (2.0 * step)


def _everything(cloud: GaussianCloud, point_map: PointMap) -> Motion:
    """Move all Gaussians by a point map, rotations included."""
    step = DIFFERENCE * scene_size(cloud.positions)

    def move(points: Float64, time: float) -> tuple[Float64, Float64]:
        # the turns of these motions stay well below pi, so that w >= 0 is the continuous choice
        turns = rotations.from_deformations(jacobians(point_map, points, time, step))
        return point_map(points, time), turns

    return Motion(np.arange(cloud.num_gaussians), move)


def sway(cloud: GaussianCloud, rng: np.random.Generator) -> Motion:
    """Wind: horizontal displacement by a smooth field that grows with the height above the ground."""
    stage = _stage(cloud, rng)
    field = field_for(cloud, rng, 2, wavelength=1.5, period=PERIOD)
    across = np.stack([stage.side, np.cross(UP, stage.side)])

    def point_map(points: Float64, time: float) -> Float64:
        share = np.clip(stage.heights(points) / stage.height, 0.0, 1.2)
        push = SWAY * stage.height * _swing(time) * field(points, time)
        return points + share[:, None] ** 2 * (push @ across)

    return _everything(cloud, point_map)


def bend(cloud: GaussianCloud, rng: np.random.Generator) -> Motion:
    """The scene as a rod: clamped at the ground, bent to an arc, straight above its height."""
    stage = _stage(cloud, rng)

    def point_map(points: Float64, time: float) -> Float64:
        local = points - stage.base
        height, side = local @ UP, local @ stage.side
        on_arc = np.clip(height, 0.0, stage.height)
        half = 0.5 * ANGLE * _swing(time) * on_arc / stage.height
        # chord of an arc of length s, angle 2h: s sin(h)/h, in the direction h; np.sinc is sin(pi x)/(pi x)
        chord = on_arc * np.sinc(half / np.pi)
        beyond = height - on_arc
        cosine, sine = np.cos(2.0 * half), np.sin(2.0 * half)
        new_side = chord * np.sin(half) + side * cosine + beyond * sine
        new_height = chord * np.cos(half) - side * sine + beyond * cosine
        change = np.outer(new_side - side, stage.side) + np.outer(new_height - height, UP)
        return points + change

    return _everything(cloud, point_map)


def twist(cloud: GaussianCloud, rng: np.random.Generator) -> Motion:
    """Turn about the vertical axis by an angle that grows with the height."""
    stage = _stage(cloud, rng)

    def point_map(points: Float64, time: float) -> Float64:
        share = np.clip(stage.heights(points) / stage.height, 0.0, 1.2)
        turns = rotations.from_vectors(np.outer(ANGLE * _swing(time) * share, UP))
        return stage.base + rotations.rotate(turns, points - stage.base)

    return _everything(cloud, point_map)


def part(cloud: GaussianCloud, rng: np.random.Generator) -> Motion:
    """A compact part turns and travels as a rigid body; the rest of the scene does not move at all."""
    points = cloud.positions.astype(np.float64)
    count = max(1, round(PART_SHARE * len(points)))
    middle = points[rng.integers(len(points))]
    index = np.sort(np.argsort(np.linalg.norm(points - middle, axis=1), kind="stable")[:count])
    centre = points[index].mean(axis=0)
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    travel = PART_TRAVEL * scene_size(points) * np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]

    def move(part_points: Float64, time: float) -> tuple[Float64, Float64]:
        phase = 2.0 * np.pi * time / PERIOD
        turn = np.concatenate([[np.cos(0.5 * phase)], np.sin(0.5 * phase) * axis])
        offset = np.array([np.sin(phase), 1.0 - np.cos(phase)]) @ travel
        moved = centre + rotations.rotate(turn, part_points - centre) + offset
        return moved, np.broadcast_to(turn, (len(part_points), 4))

    return Motion(index, move)


#: how a splat can move, by name
MOTIONS: dict[str, Callable[[GaussianCloud, np.random.Generator], Motion]] = {
    "part": part,
    "sway": sway,
    "bend": bend,
    "twist": twist,
}


def apply_motion(cloud: GaussianCloud, motion: Motion, time: float) -> GaussianCloud:
    """The rest frame `cloud` moved to `time` seconds; whatever `motion` does not name stays bit-identical."""
    positions, quaternions = cloud.positions.copy(), cloud.rotations.copy()
    moved, turns = motion.move(cloud.positions[motion.index].astype(np.float64), time)
    positions[motion.index] = moved
    # lengths are kept: a trained splat's quaternions are rarely normalised
    quaternions[motion.index] = rotations.multiply(turns, cloud.rotations[motion.index])
    return replace(cloud, positions=positions, rotations=quaternions)


def trained_sequence(
    cloud: GaussianCloud, options: SceneOptions | None = None, motion: str = "part"
) -> Iterator[GaussianCloud]:
    """Frames of a static splat moving by one of MOTIONS; SH are constant, as 3DGStream keeps them.

    Raises InputError for an unknown motion.
    """
    options = options or SceneOptions()
    if motion not in MOTIONS:
        raise InputError(f"no motion {motion!r}; there are {', '.join(MOTIONS)}")
    cloud = reduce_cloud(cloud, options)
    chosen = MOTIONS[motion](cloud, np.random.default_rng([options.seed, MOTION_STREAM]))
    yield cloud
    for index in range(1, options.num_frames):
        yield apply_motion(cloud, chosen, index / options.fps)
