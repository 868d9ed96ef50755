"""A room that no file has: planks, wallpaper and a ceiling, their textures drawn from random numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfcgs_codec.array_types import Float64, UInt8
from lab.meshes.asset import Material, Primitive

#: texels of a side of each texture
TEXELS = 512
#: scene units that a texture covers before it repeats
PERIOD = 4.0


@dataclass(frozen=True)
class Shell:
    """Half width and half depth (x, z) and height of an empty room around the origin, open towards +z."""

    width: float
    depth: float
    height: float


def shell_primitives(shell: Shell) -> list[Primitive]:
    """Floor, ceiling, and the walls behind, to the left and to the right."""
    w, d, h = shell.width, shell.depth, shell.height
    floor = [[-w, 0, d], [w, 0, d], [w, 0, -d], [-w, 0, -d]]
    ceiling = [[x, h, z] for x, _, z in floor]
    back = [[-w, 0, -d], [w, 0, -d], [w, h, -d], [-w, h, -d]]
    left = [[-w, 0, d], [-w, 0, -d], [-w, h, -d], [-w, h, d]]
    right = [[w, 0, -d], [w, 0, d], [w, h, d], [w, h, -d]]
    planks, paper, plaster = _planks(), _paper(), _plaster()
    textures = (planks, plaster, paper, paper, paper)
    sheets = (floor, ceiling, back, left, right)
    return [_sheet(np.array(c, np.float64), t) for c, t in zip(sheets, textures, strict=True)]


def _sheet(corners: Float64, texture: UInt8) -> Primitive:
    """A rectangle (4, 3), its texture repeated along both sides."""
    sides = np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[3] - corners[0])
    u, v = (float(side) / PERIOD for side in sides)
    return Primitive(
        node=0,
        skin=None,
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        vertices=corners,
        morph=np.zeros((0, 4, 3)),
        morph_weights=np.zeros(0),
        joints=np.zeros((4, 0), np.int64),
        joint_weights=np.zeros((4, 0)),
        uv=np.array([[0.0, v], [u, v], [u, 0.0], [0.0, 0.0]]),
        colors=np.ones((4, 4)),
        material=Material(np.ones(4), texture, False),
    )


def _planks() -> UInt8:
    """Eight boards of brown wood, with grain along them and dark gaps between."""
    rng = np.random.default_rng(1)
    board = np.arange(TEXELS) // (TEXELS // 8)
    shade = rng.uniform(0.75, 1.1, 8)[board][:, None] * np.ones(TEXELS)
    grain = np.repeat(rng.normal(0.0, 0.08, (TEXELS, TEXELS // 32)), 32, axis=1)
    gap = (np.arange(TEXELS) % (TEXELS // 8) < 3)[:, None]
    return _texture((shade + grain) * np.where(gap, 0.4, 1.0), (150, 98, 60))


def _paper() -> UInt8:
    """Wallpaper: stripes, and small spots between them."""
    v, u = np.mgrid[0:TEXELS, 0:TEXELS] / TEXELS
    stripes = 1.0 - 0.15 * (np.floor(12.0 * u) % 2.0)
    spots = (np.cos(24.0 * np.pi * u) * np.cos(16.0 * np.pi * v)) > 0.85
    rng = np.random.default_rng(2)
    return _texture(stripes * np.where(spots, 0.6, 1.0) + rng.normal(0.0, 0.02, u.shape), (196, 204, 170))


def _plaster() -> UInt8:
    rng = np.random.default_rng(3)
    coarse = np.kron(rng.normal(0.0, 0.03, (TEXELS // 8, TEXELS // 8)), np.ones((8, 8)))
    return _texture(1.0 + coarse, (225, 220, 212))


def _texture(shade: Float64, colour: tuple[int, int, int]) -> UInt8:
    """(H, W) brightness of one colour -> (H, W, 4)."""
    rgb = np.clip(shade[:, :, None] * np.array(colour), 0, 255)
    return np.concatenate([rgb, np.full((*shade.shape, 1), 255)], axis=2).astype(np.uint8)
