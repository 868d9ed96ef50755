"""Gaussians on the surface of an animated glTF asset: fixed number and order, moving with their triangles.

Each Gaussian is sampled once, on the first posed frame, and keeps its triangle and barycentric coordinates,
as if a perfect tracker had followed it: positions and rotations move, everything else is constant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Float32, Float64, Int64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from lab.meshes import appearance
from lab.meshes.asset import Asset, Clip
from lab.meshes.gltf import load_asset
from lab.meshes.posing import pose_vertices
from lab.scenes import rotations
from lab.scenes.fields import scene_size
from lab.scenes.options import SceneOptions

#: a clip whose last pose is this close to its first (share of the size) is a cycle; others play to and fro
CYCLE_TOLERANCE = 0.01
#: log-scale in the surface relative to the spacing of the samples, and its spread; the thin axis relative to
#: those two (medians of trained splats are about 0, -0.7 and -1.2; the surfaces here are flatter)
FLAT_LOG_SCALE = (-0.45, 0.35)
THIN_LOG_RATIO = (-2.0, 0.4)
#: logit-opacity, mean and spread
OPACITY = (2.0, 1.5)
NEIGHBOURS = 3
#: a triangle below this share of its sampled area has no usable frame, and holds its last rotation
COLLAPSED = 1e-6


@dataclass(frozen=True)
class Surface:
    """What is sampled once; N Gaussians on F triangles that carry at least one."""

    corners: Int64  # (F, 3) vertices
    triangle: Int64  # (N,) index into `corners`
    barycentric: Float64  # (N, 3)
    twist: Float64  # (N, 4) rotation about the normal, in the triangle's frame
    rest_inverse: Float64  # (F, 2, 2) inverse of the edges in the triangle's own frame
    rest_area: Float64  # (F,)
    scales: Float32
    opacities: Float32
    sh_dc: Float32
    sh_rest: Float32


def select_clip(asset: Asset, clip: str | int) -> Clip | None:
    """The animation of that name or index; None for an asset without any."""
    if not asset.clips:
        return None
    names = [c.name for c in asset.clips]
    if isinstance(clip, str) and clip in names:
        return asset.clips[names.index(clip)]
    number = int(clip) if str(clip).isdecimal() else -1
    if 0 <= number < len(names):
        return asset.clips[number]
    raise InputError(f"no clip {clip!r}; the asset has {', '.join(names)}")


def clip_time(clip: Clip, seconds: float, cyclic: bool) -> float:
    """Time in the clip after `seconds` of endless play: from the start again, or to and fro."""
    length = clip.end - clip.start
    if length <= 0.0:
        return clip.start
    if cyclic:
        return clip.start + seconds % length
    return clip.start + length - abs(length - seconds % (2.0 * length))


def is_cyclic(asset: Asset, clip: Clip) -> bool:
    """Whether the clip ends where it starts."""
    start = pose_vertices(asset, clip, clip.start)
    end = pose_vertices(asset, clip, clip.end)
    return bool(np.abs(end - start).max() < CYCLE_TOLERANCE * scene_size(start))


def triangle_edges(vertices: Float64, corners: Int64) -> tuple[Float64, Float64, Float64]:
    """First edge, second edge and their cross product (normal times twice the area), each (F, 3)."""
    first, second, third = (vertices[corners[:, i]] for i in range(3))
    return second - first, third - first, np.cross(second - first, third - first)


def triangle_frames(vertices: Float64, corners: Int64) -> tuple[Float64, Float64, Float64]:
    """Frames (F, 3, 3) with columns first edge, bitangent, normal; edges in them (F, 2, 2); areas (F,)."""
    first, second, cross = triangle_edges(vertices, corners)
    double_area = np.linalg.norm(cross, axis=1)
    tiny = np.finfo(np.float64).tiny
    normal = cross / np.maximum(double_area, tiny)[:, None]
    length = np.linalg.norm(first, axis=1)
    tangent = first / np.maximum(length, tiny)[:, None]
    frames = np.stack([tangent, np.cross(normal, tangent), normal], axis=2)
    edges = np.zeros((len(corners), 2, 2))
    edges[:, 0, 0] = length
    edges[:, 0, 1] = np.einsum("fi,fi->f", second, tangent)
    edges[:, 1, 1] = double_area / np.maximum(length, tiny)
    return frames, edges, 0.5 * double_area


def surface_rotations(surface: Surface, vertices: Float64, previous: Float64 | None) -> Float64:
    """(N, 4) rotations: the triangle's frame, turned in its plane as the triangle's interior turns.

    The turn is the rotation part of the in-plane deformation (its closed form in 2-D), so that shear does not
    favour the edge that happens to come first. `previous` is the last frame's result.
    """
    frames, edges, areas = triangle_frames(vertices, surface.corners)
    deformation = edges @ surface.rest_inverse
    turn = np.arctan2(
        deformation[:, 1, 0] - deformation[:, 0, 1], deformation[:, 0, 0] + deformation[:, 1, 1]
    )
    spin = rotations.from_vectors(turn[:, None] * np.array([0.0, 0.0, 1.0]))
    usable = areas > COLLAPSED * surface.rest_area
    frames[~usable] = np.eye(3)
    per_triangle = rotations.multiply(rotations.from_matrices(frames), spin)
    result = rotations.multiply(per_triangle[surface.triangle], surface.twist)
    if previous is not None:
        result = np.where(usable[surface.triangle, None], result, previous)
    return rotations.continuous_sign(result, previous)


def surface_positions(surface: Surface, vertices: Float64) -> Float64:
    """(N, 3) positions on the posed triangles."""
    return np.einsum("nc,ncd->nd", surface.barycentric, vertices[surface.corners[surface.triangle]])


def sample_surface(asset: Asset, vertices: Float64, options: SceneOptions) -> Surface:
    """Sample Gaussians uniformly by area on the posed `vertices` (V, 3)."""
    rng = np.random.default_rng(options.seed)
    starts = np.cumsum([0] + [len(p.vertices) for p in asset.primitives[:-1]])
    corners = np.concatenate([p.faces + s for p, s in zip(asset.primitives, starts, strict=True)])
    faces, barycentric = _sample_points(vertices, corners, options.surface_gaussians, rng)
    carrying, triangle = np.unique(faces, return_inverse=True)
    frames, edges, areas = triangle_frames(vertices, corners[carrying])
    normals = frames[triangle, :, 2]
    rgba = _colors(asset, faces, barycentric)
    positions = np.einsum("nc,ncd->nd", barycentric, vertices[corners[faces]])
    typical = float(np.sqrt(areas.sum() / len(faces)))
    logits = rng.normal(*OPACITY, len(faces)) + np.log(np.clip(rgba[:, 3], 1e-3, 1.0))
    turns = rng.uniform(-np.pi, np.pi, (len(faces), 1)) * np.array([0.0, 0.0, 1.0])
    return Surface(
        corners=corners[carrying],
        triangle=triangle,
        barycentric=barycentric,
        twist=rotations.from_vectors(turns),
        rest_inverse=np.linalg.inv(edges),
        rest_area=areas,
        scales=_log_scales(positions, typical, rng).astype(np.float32),
        opacities=logits.astype(np.float32),
        sh_dc=appearance.sh_dc(rgba[:, :3], normals).astype(np.float32),
        sh_rest=appearance.sh_rest(normals, options.surface_sh_degree, rng).astype(np.float32),
    )


def _sample_points(
    vertices: Float64, corners: Int64, count: int, rng: np.random.Generator
) -> tuple[Int64, Float64]:
    """Stratified by area: faces (N,) and barycentric coordinates (N, 3), in random order.

    Random order, because trained splats have none that a codec could profit from.
    """
    areas = 0.5 * np.linalg.norm(triangle_edges(vertices, corners)[2], axis=1)
    cumulative = np.cumsum(areas)
    if cumulative[-1] <= 0.0:
        raise InputError("the surface has no area in its first pose; choose another clip")
    strata = (rng.permutation(count) + rng.random(count)) / count
    # the last face with an area catches a stratum that rounding puts at the very end
    last = int(np.flatnonzero(areas)[-1])
    faces = np.minimum(np.searchsorted(cumulative, strata * cumulative[-1], side="right"), last)
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    return faces, np.stack([1.0 - root, root * (1.0 - along), root * along], axis=1)


def _log_scales(positions: Float64, typical: float, rng: np.random.Generator) -> Float64:
    """(N, 3): two axes in the surface as long as the samples are apart, a third that is thinner."""
    count = len(positions)
    neighbours = min(NEIGHBOURS, count - 1)
    spacing = np.full(count, typical)
    if neighbours:
        distances = np.atleast_2d(cKDTree(positions).query(positions, neighbours + 1)[0])
        spacing = np.clip(distances[:, 1:].mean(axis=1), 0.2 * typical, 5.0 * typical)
    scales = np.log(spacing)[:, None] + rng.normal(*FLAT_LOG_SCALE, (count, 3))
    scales[:, 2] = scales[:, :2].mean(axis=1) + rng.normal(*THIN_LOG_RATIO, count)
    return scales


def _colors(asset: Asset, faces: Int64, barycentric: Float64) -> Float64:
    """(N, 4) linear RGBA, each point from its own primitive."""
    rgba = np.empty((len(faces), 4))
    start = 0
    for primitive in asset.primitives:
        inside = np.flatnonzero((faces >= start) & (faces < start + len(primitive.faces)))
        rgba[inside] = appearance.primitive_colors(primitive, faces[inside] - start, barycentric[inside])
        start += len(primitive.faces)
    return rgba


def animated_sequence(
    path: Path | str, options: SceneOptions | None = None, clip: str | int = 0
) -> Iterator[GaussianCloud]:
    """Frames of an animated .glb or .gltf file, in its own units; `clip` is a name or an index.

    N and order are those of the first frame; scales, opacities and SH are bit-identical in all frames, and a
    quaternion keeps the sign nearest to its last one.
    """
    options = options or SceneOptions()
    asset = load_asset(path)
    chosen = select_clip(asset, clip)
    cyclic = chosen is not None and is_cyclic(asset, chosen)
    surface: Surface | None = None
    turned: Float64 | None = None
    for index in range(options.num_frames):
        time = 0.0 if chosen is None else clip_time(chosen, index / options.fps, cyclic)
        vertices = pose_vertices(asset, chosen, time)
        surface = surface or sample_surface(asset, vertices, options)
        turned = surface_rotations(surface, vertices, turned)
        yield GaussianCloud(
            positions=surface_positions(surface, vertices).astype(np.float32),
            rotations=turned.astype(np.float32),
            scales=surface.scales,
            opacities=surface.opacities,
            sh_dc=surface.sh_dc,
            sh_rest=surface.sh_rest,
        )
