"""An animated asset as numpy arrays: what `gltf` reads and `posing` poses.

V vertices, F faces, T morph targets, J joints. Quaternions are x, y, z, w here, as in glTF; everything is in
the asset's own units.
"""

from __future__ import annotations

from dataclasses import dataclass

from dfcgs_codec.array_types import Float64, Int64, UInt8


@dataclass(frozen=True)
class Node:
    """A node's rest transform: `matrix` (4, 4), or translation, rotation, scale."""

    parent: int
    matrix: Float64 | None
    translation: Float64
    rotation: Float64
    scale: Float64


@dataclass(frozen=True)
class Channel:
    """One animated property with keys at `times` (T,), seconds.

    `values` is (T, C), or for CUBICSPLINE (T, 3, C): in-tangent, value, out-tangent.
    """

    node: int
    path: str
    interpolation: str
    times: Float64
    values: Float64


@dataclass(frozen=True)
class Clip:
    """One animation; `start` and `end` in seconds."""

    name: str
    channels: tuple[Channel, ...]
    start: float
    end: float


@dataclass(frozen=True)
class Skin:
    """`joints` (J,) node indices, `inverse_bind` (J, 4, 4)."""

    joints: Int64
    inverse_bind: Float64


@dataclass(frozen=True)
class Material:
    """Linear RGBA factor (4,), sRGB texture (H, W, 4) uint8 or None, and whether alpha counts."""

    factor: Float64
    texture: UInt8 | None
    uses_alpha: bool


@dataclass(frozen=True)
class Primitive:
    """A triangle list drawn by one node: V vertices, F triangles, T morph targets, J joints per vertex."""

    node: int
    skin: int | None
    faces: Int64  # (F, 3)
    vertices: Float64  # (V, 3)
    morph: Float64  # (T, V, 3)
    morph_weights: Float64  # (T,) at rest
    joints: Int64  # (V, J)
    joint_weights: Float64  # (V, J), rows sum to one
    uv: Float64 | None  # (V, 2)
    colors: Float64  # (V, 4) linear
    material: Material


@dataclass(frozen=True)
class Asset:
    """Everything needed to pose and colour the default scene. `order` lists nodes, parents first."""

    nodes: tuple[Node, ...]
    order: tuple[int, ...]
    primitives: tuple[Primitive, ...]
    skins: tuple[Skin, ...]
    clips: tuple[Clip, ...]
