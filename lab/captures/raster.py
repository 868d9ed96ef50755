"""Which triangle each pixel shows: a z-buffer without clipping (Olano and Greer 1997), compiled by numba.

In homogeneous coordinates the three edges of a triangle are planes through the camera, and a pixel's ray lies
between them or not, wherever the corners are: before the camera, behind it, or both.
"""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int32
from lab.render.camera import Camera
from lab.render.kernel import kernel

#: scene units; nothing nearer than this is drawn
NEAR = 0.05
#: a triangle seen at its edge, with less volume than this between it and the camera, is not drawn
FLAT = 1e-12


def visible_faces(
    corners: Float64, camera: Camera, behind: Float64 | None = None
) -> tuple[Int32, Float64, Float64]:
    """The face that each pixel shows, (H, W), or -1; where on it, (H, W, 3) barycentric; 1 / depth, (H, W).

    corners: (F, 3, 3), places in the world. behind: (H, W) 1 / depth of what else there is, 0 for nothing.
    """
    seen = corners @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    seen = np.ascontiguousarray(seen)
    face = np.full((camera.height, camera.width), -1, np.int32)
    inverse_depth = np.zeros(face.shape) if behind is None else behind.copy()
    weights = np.zeros((*face.shape, 3))
    lens = (float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy))
    _draw(seen, lens, NEAR, face, inverse_depth, weights)
    return face, weights, inverse_depth


@kernel
def _draw(seen, lens, near, face, inverse_depth, weights):
    height, width = face.shape
    planes = np.empty((3, 3))
    for f in range(len(seen)):
        corners = seen[f]
        if max(corners[0, 2], corners[1, 2], corners[2, 2]) < near:
            continue
        if not _edge_planes(corners, planes):
            continue
        left, right, top, bottom = _bounds(corners, lens, near, width, height)
        for row in range(top, bottom):
            y = (row + 0.5 - lens[3]) / lens[1]
            for column in range(left, right):
                x = (column + 0.5 - lens[2]) / lens[0]
                a = planes[0, 0] * x + planes[0, 1] * y + planes[0, 2]
                b = planes[1, 0] * x + planes[1, 1] * y + planes[1, 2]
                c = planes[2, 0] * x + planes[2, 1] * y + planes[2, 2]
                # along the ray (x, y, 1) the shares of the corners are a, b, c times the depth
                total = a + b + c
                if a < 0.0 or b < 0.0 or c < 0.0 or total <= inverse_depth[row, column]:
                    continue
                if total * near > 1.0:
                    continue
                inverse_depth[row, column] = total
                face[row, column] = f
                weights[row, column, 0] = a / total
                weights[row, column, 1] = b / total
                weights[row, column, 2] = c / total


@kernel
def _edge_planes(corners, planes):
    """The inverse of the matrix whose columns are the corners; false for a triangle seen at its edge."""
    for i in range(3):
        p, q = corners[(i + 1) % 3], corners[(i + 2) % 3]
        planes[i, 0] = p[1] * q[2] - p[2] * q[1]
        planes[i, 1] = p[2] * q[0] - p[0] * q[2]
        planes[i, 2] = p[0] * q[1] - p[1] * q[0]
    volume = planes[0, 0] * corners[0, 0] + planes[0, 1] * corners[0, 1] + planes[0, 2] * corners[0, 2]
    if abs(volume) < FLAT:
        return False
    for i in range(3):
        for j in range(3):
            planes[i, j] /= volume
    return True


@kernel
def _bounds(corners, lens, near, width, height):
    """First and end pixel in x and y that the triangle can show in; the whole image if a corner is behind."""
    if min(corners[0, 2], corners[1, 2], corners[2, 2]) < near:
        return 0, width, 0, height
    left, right, top, bottom = 1e9, -1e9, 1e9, -1e9
    for i in range(3):
        u = lens[0] * corners[i, 0] / corners[i, 2] + lens[2]
        v = lens[1] * corners[i, 1] / corners[i, 2] + lens[3]
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    first, end = min(max(left, 0.0), width), min(max(right + 1.0, 0.0), width)
    above, below = min(max(top, 0.0), height), min(max(bottom + 1.0, 0.0), height)
    return int(first), int(end), int(above), int(below)
