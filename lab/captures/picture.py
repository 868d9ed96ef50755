"""The true images: textured triangles under one lamp, (H, W, 3) display values."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Float32, Float64, Int64
from lab.captures.mesh import Mesh
from lab.captures.raster import visible_faces
from lab.captures.rooms import Room
from lab.meshes.appearance import primitive_colors, to_srgb
from lab.render import Camera

#: each pixel is the mean of this many by as many
OVERSAMPLING = 3
#: share of light that comes from everywhere, and of that from the lamp, on a surface that faces it nearby
AMBIENT, LAMP = 0.55, 0.75
#: scene units; the lamp is half as bright at this distance
REACH = 7.0
#: height of the highlight of a glossy surface (linear), and its sharpness as Blinn's exponent
GLOSS, SHININESS = 0.12, 12.0


@dataclass(frozen=True)
class Seen:
    """The points that n pixels show: places, normals towards the camera, colours, (n, 3) each."""

    points: Float64
    normals: Float64
    colours: Float64


@dataclass(frozen=True)
class Layer:
    """What a camera sees so far, OVERSAMPLING times as fine: display values (H, W, 3), 1 / depth (H, W)."""

    colours: Float32
    inverse_depth: Float64


def layer(mesh: Mesh, room: Room, camera: Camera, behind: Layer | None = None) -> Layer:
    """What the camera sees of the mesh, before what stands `behind`, or before the sky."""
    fine = _finer(camera)
    depth = None if behind is None else behind.inverse_depth
    face, weights, inverse_depth = visible_faces(mesh.corners, fine, depth)
    hit = face >= 0
    colours = to_srgb(_sky(room, fine)).astype(np.float32) if behind is None else behind.colours.copy()
    seen = _seen(mesh, face[hit].astype(np.int64), weights[hit], camera)
    colours[hit] = to_srgb(lit(seen, room, camera.position))
    return Layer(colours, inverse_depth)


def image(seen: Layer) -> Float32:
    """(H, W, 3) display values at the camera's own size."""
    k = OVERSAMPLING
    height, width = (side // k for side in seen.inverse_depth.shape)
    blocks = seen.colours.reshape(height, k, width, k, 3)
    return np.ascontiguousarray(blocks.mean(axis=(1, 3), dtype=np.float64), dtype=np.float32)


def _finer(camera: Camera) -> Camera:
    k = OVERSAMPLING
    scaled = {name: k * getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    return replace(camera, **scaled)


def _sky(room: Room, camera: Camera) -> Float64:
    """(H, W, 3) linear: from the lower colour to the upper one, by the height at which a ray looks."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=2)
    upward = rays @ camera.world_to_camera[:3, 1] / np.linalg.norm(rays, axis=2)
    low, high = (np.array(colour) for colour in room.sky)
    share = 0.5 + 0.5 * upward[:, :, None]
    return low + share * (high - low)


def _seen(mesh: Mesh, faces: Int64, weights: Float64, camera: Camera) -> Seen:
    corners = mesh.corners[faces]
    points = np.einsum("nc,ncd->nd", weights, corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    away = np.einsum("nd,nd->n", normals, points - camera.position) > 0.0
    normals[away] *= -1.0
    return Seen(points, normals, _colours(mesh, faces, weights))


def _colours(mesh: Mesh, faces: Int64, weights: Float64) -> Float64:
    """(n, 3) linear colours before light; alpha does not count."""
    colours = np.empty((len(faces), 3))
    whose, own = mesh.primitive[faces], mesh.face[faces]
    for index in np.unique(whose):
        rows = np.flatnonzero(whose == index)
        colours[rows] = primitive_colors(mesh.primitives[index], own[rows], weights[rows])[:, :3]
    return colours


def lit(seen: Seen, room: Room, eye: Float64) -> Float64:
    """(n, 3) linear light from the points towards `eye`: diffuse without shadows, and a highlight."""
    to_lamp = np.array(room.lamp) - seen.points
    distance = np.linalg.norm(to_lamp, axis=1, keepdims=True)
    to_lamp /= np.maximum(distance, 1e-9)
    to_eye = eye - seen.points
    to_eye /= np.maximum(np.linalg.norm(to_eye, axis=1, keepdims=True), 1e-9)
    half = to_lamp + to_eye
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
    facing = np.maximum(np.einsum("nd,nd->n", seen.normals, to_lamp), 0.0)[:, None]
    mirrored = np.maximum(np.einsum("nd,nd->n", seen.normals, half), 0.0)[:, None]
    nearness = 1.0 / (1.0 + (distance / REACH) ** 2)
    highlight = GLOSS * nearness * (facing > 0.0) * mirrored**SHININESS
    return seen.colours * (AMBIENT + LAMP * nearness * facing) + highlight
