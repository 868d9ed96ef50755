"""Rooms and characters as triangles: F faces with three corners each, and what colours them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float64, Int64
from lab.captures.rooms import FOLDER, Piece, Room, Triple
from lab.captures.shell import shell_primitives
from lab.meshes.asset import Asset, Primitive
from lab.meshes.gltf import load_asset
from lab.meshes.posing import pose_vertices
from lab.scenes.animated import clip_time, is_cyclic, select_clip


@dataclass(frozen=True)
class Mesh:
    """Triangles in the world.

    corners (F, 3, 3): the places of the corners.
    primitive (F,): whose face it is, an index into `primitives`; face (F,): which of that primitive's own.
    """

    corners: Float64
    primitive: Int64
    face: Int64
    primitives: tuple[Primitive, ...]


def joined(*meshes: Mesh) -> Mesh:
    """All triangles of several meshes."""
    starts = np.cumsum([0] + [len(mesh.primitives) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.corners for mesh in meshes]),
        np.concatenate([mesh.primitive + start for mesh, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.face for mesh in meshes]),
        tuple(primitive for mesh in meshes for primitive in mesh.primitives),
    )


def room_mesh(room: Room) -> Mesh:
    """All pieces of a room in their places."""
    pieces = [_piece_mesh(piece) for piece in room.pieces]
    if room.shell is not None:
        primitives = tuple(shell_primitives(room.shell))
        pieces.append(_mesh(primitives, np.concatenate([p.vertices for p in primitives])))
    return joined(*pieces)


def _piece_mesh(piece: Piece) -> Mesh:
    asset = load_asset(FOLDER / piece.file)
    return _mesh(
        asset.primitives, placed(pose_vertices(asset, None, 0.0), piece.place, piece.turn, piece.scale)
    )


def placed(points: Float64, place: Triple, turn: float, scale: float) -> Float64:
    """Points (n, 3), scaled, turned about +y by `turn` degrees, moved to `place`."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return scale * points @ about_y.T + np.array(place)


def _mesh(primitives: tuple[Primitive, ...], vertices: Float64) -> Mesh:
    """Primitives whose vertices, one after the other, are at `vertices`."""
    starts = np.cumsum([0] + [len(p.vertices) for p in primitives[:-1]])
    corners = [vertices[p.faces + start] for p, start in zip(primitives, starts, strict=True)]
    counts = [len(p.faces) for p in primitives]
    return Mesh(
        np.concatenate(corners),
        np.repeat(np.arange(len(counts)), counts),
        np.concatenate([np.arange(count) for count in counts]),
        primitives,
    )


@dataclass(frozen=True)
class Actor:
    """A character that plays `clip`; a file of `assets` or of `assets/rooms/characters`.

    fps: frames a second of the asset's own time. skipped: frames left out at the start.
    size: its height in the first frame, None for that of the asset. turn: degrees about +y.
    """

    asset: str
    clip: str
    fps: float = 30.0
    skipped: int = 0
    place: Triple = (0.0, 0.0, 0.0)
    turn: float = 0.0
    size: float | None = None


def actor_path(asset: str) -> Path:
    """Where a character lies: among those of the rooms, or in `assets` with all its clips."""
    with_one_clip = FOLDER / "characters" / asset
    return with_one_clip if with_one_clip.exists() else FOLDER.parent / asset


def actor_meshes(actor: Actor, num_frames: int) -> Iterator[Mesh]:
    """The character, frame after frame."""
    asset = load_asset(actor_path(actor.asset))
    scale: float | None = None
    for vertices in islice(_poses(asset, actor, num_frames), actor.skipped, None):
        scale = scale or (actor.size / float(np.ptp(vertices[:, 1])) if actor.size else 1.0)
        yield _mesh(asset.primitives, placed(vertices, actor.place, actor.turn, scale))


def _poses(asset: Asset, actor: Actor, num_frames: int) -> Iterator[Float64]:
    clip = select_clip(asset, actor.clip)
    if clip is None:
        raise ValueError(f"{actor.asset} has no clips")
    cyclic = is_cyclic(asset, clip)
    for index in range(num_frames + actor.skipped):
        yield pose_vertices(asset, clip, clip_time(clip, index / actor.fps, cyclic))
