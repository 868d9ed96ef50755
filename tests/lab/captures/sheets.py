"""Rooms of a few triangles, and small cameras that see them."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float32
from lab.captures.mesh import Mesh
from lab.captures.picture import image, layer
from lab.captures.rigs import Rig
from lab.captures.rooms import Room
from lab.meshes.asset import Material, Primitive
from lab.render import Camera, look_at

SIZE = (32, 24)
RIGS = {
    "forward": Rig("forward", (0.5, 2.0, 6.0), (0.0, 1.0, 0.0), 45.0),
    "inside": Rig("inside", (3.0, 2.0, 0.0), (0.0, 1.0, 0.0), 60.0),
}
#: an empty room: what is in it is made by the tests
BARE = Room((), lamp=(0.0, 3.0, 0.0))


def sheet(corners: list[list[float]], colour: tuple[float, float, float] = (0.5, 0.2, 0.1)) -> Mesh:
    """Two triangles between four corners."""
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    vertices = np.array(corners, np.float64)
    primitive = Primitive(
        node=0,
        skin=None,
        faces=faces,
        vertices=vertices,
        morph=np.zeros((0, 4, 3)),
        morph_weights=np.zeros(0),
        joints=np.zeros((4, 0), np.int64),
        joint_weights=np.zeros((4, 0)),
        uv=None,
        colors=np.ones((4, 4)),
        material=Material(np.array([*colour, 1.0]), None, False),
    )
    return Mesh(vertices[faces], np.zeros(2, np.int64), np.arange(2), (primitive,))


def upright(half: float, z: float) -> Mesh:
    return sheet([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])


FLOOR = [[-50.0, 0.0, -50.0], [50.0, 0.0, -50.0], [50.0, 0.0, 50.0], [-50.0, 0.0, 50.0]]
FRONT = look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), SIZE, 60.0)


def picture(mesh: Mesh, room: Room, camera: Camera) -> Float32:
    return image(layer(mesh, room, camera))
