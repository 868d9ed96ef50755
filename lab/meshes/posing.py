"""Pose an asset: interpolate its animation, walk the node tree, morph and skin the vertices.

glTF 2.0 specification, sections "Animations", "Transformations", "Skins", "Morph Targets" and appendix C
(interpolation).
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64
from lab.meshes.asset import Asset, Channel, Clip, Node, Primitive, Skin

#: below this angle (radians, cosine 0.9995) slerp is replaced by a normalised lerp, as appendix C allows
LERP_COSINE = 0.9995

NodeValues = dict[tuple[int, str], Float64]


def slerp(start: Float64, end: Float64, fraction: float) -> Float64:
    """Shortest-path spherical interpolation of two unit quaternions."""
    cosine = float(start @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > LERP_COSINE:
        mixed = start + fraction * (end - start)
        return mixed / np.linalg.norm(mixed)
    angle = np.arccos(min(cosine, 1.0))
    return (np.sin((1.0 - fraction) * angle) * start + np.sin(fraction * angle) * end) / np.sin(angle)


def interpolate(channel: Channel, time: float) -> Float64:
    """The channel's value at `time` seconds, held before its first and after its last key."""
    times, cubic = channel.times, channel.interpolation == "CUBICSPLINE"
    last = len(times) - 1
    left = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, last))
    right = min(left + 1, last)
    span = times[right] - times[left]
    fraction = float(np.clip((time - times[left]) / span, 0.0, 1.0)) if span > 0.0 else 0.0
    if cubic:
        value = _hermite(channel.values[left], channel.values[right], span, fraction)
        return value / np.linalg.norm(value) if channel.path == "rotation" else value
    start, end = channel.values[left], channel.values[right]
    if channel.interpolation == "STEP" or fraction == 0.0:
        return start
    if channel.path == "rotation":
        return slerp(start / np.linalg.norm(start), end / np.linalg.norm(end), fraction)
    return start + fraction * (end - start)


def _hermite(start: Float64, end: Float64, span: float, fraction: float) -> Float64:
    """Appendix C.5; `start` and `end` are (3, C): in-tangent, value, out-tangent."""
    t, t2, t3 = fraction, fraction**2, fraction**3
    return (
        (2.0 * t3 - 3.0 * t2 + 1.0) * start[1]
        + span * (t3 - 2.0 * t2 + t) * start[2]
        + (3.0 * t2 - 2.0 * t3) * end[1]
        + span * (t3 - t2) * end[0]
    )


def node_values(clip: Clip | None, time: float) -> NodeValues:
    """What the clip sets at `time`: (node, path) -> value."""
    channels = () if clip is None else clip.channels
    return {(c.node, c.path): interpolate(c, time) for c in channels}


def local_matrix(index: int, node: Node, values: NodeValues) -> Float64:
    """(4, 4) transform of a node relative to its parent."""
    animated = any((index, path) in values for path in ("translation", "rotation", "scale"))
    if node.matrix is not None and not animated:
        return node.matrix
    x, y, z, w = values.get((index, "rotation"), node.rotation)
    n = x * x + y * y + z * z + w * w
    rotation = np.eye(3) + (2.0 / n) * np.array(
        [
            [-y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, -x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, -x * x - y * y],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * values.get((index, "scale"), node.scale)
    matrix[:3, 3] = values.get((index, "translation"), node.translation)
    return matrix


def world_matrices(asset: Asset, values: NodeValues) -> dict[int, Float64]:
    """(4, 4) transform to the world of every node of the scene."""
    world: dict[int, Float64] = {}
    for index in asset.order:
        node = asset.nodes[index]
        local = local_matrix(index, node, values)
        world[index] = world[node.parent] @ local if node.parent in world else local
    return world


def pose_vertices(asset: Asset, clip: Clip | None, time: float) -> Float64:
    """World positions (V, 3) of all vertices, primitive after primitive, at `time` seconds of `clip`."""
    values = node_values(clip, time)
    world = world_matrices(asset, values)
    palettes = [_palette(skin, world) for skin in asset.skins]
    posed = [_pose_primitive(p, values, world[p.node], palettes) for p in asset.primitives]
    return np.concatenate(posed)


def _palette(skin: Skin, world: dict[int, Float64]) -> Float64:
    """(J, 4, 4) joint matrices; a joint outside the scene (against the specification) stays at rest."""
    joints = np.stack([world.get(int(j), np.eye(4)) for j in skin.joints])
    return joints @ skin.inverse_bind


def _pose_primitive(p: Primitive, values: NodeValues, world: Float64, palettes: list[Float64]) -> Float64:
    vertices = p.vertices
    if len(p.morph):
        weights = values.get((p.node, "weights"), p.morph_weights)
        vertices = vertices + np.tensordot(weights, p.morph, axes=1)
    if p.skin is None:
        return vertices @ world[:3, :3].T + world[:3, 3]
    # the node's own transform does not apply to a skinned mesh (section "Skinned Mesh Attributes")
    matrices = palettes[p.skin][p.joints]
    blended = np.einsum("vj,vjab->vab", p.joint_weights, matrices[:, :, :3])
    return np.einsum("vab,vb->va", blended[:, :, :3], vertices) + blended[:, :, 3]
