"""Triangles to images, rooms, rigs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("numba", reason="the renderer is compiled by numba, from the eval extra")

from lab.captures.captures import CAPTURES
from lab.captures.mesh import Actor, actor_meshes, actor_path, joined, placed, room_mesh
from lab.captures.picture import image, layer
from lab.captures.raster import visible_faces
from lab.captures.rigs import evaluation_cameras, fitting_cameras, inria_cameras
from lab.captures.rooms import FOLDER, ROOMS
from lab.render import look_at
from tests.lab.captures.sheets import BARE, FLOOR, FRONT, RIGS, SIZE, picture, sheet, upright


class TestRaster:
    def test_a_square_covers_its_projection(self) -> None:
        face, _, _ = visible_faces(upright(1.0, 0.0).corners, FRONT)
        rows, columns = np.nonzero(face >= 0)
        half = FRONT.fy / 4.0
        assert (rows.min(), rows.max() + 1) == (round(12 - half), round(12 + half))
        assert (columns.min(), columns.max() + 1) == (round(16 - half), round(16 + half))
        assert len(rows) == (rows.max() + 1 - rows.min()) * (columns.max() + 1 - columns.min())

    def test_the_nearer_one_shows(self) -> None:
        near, far = upright(0.5, 1.0), upright(3.0, 0.0)
        for mesh, first in ((joined(near, far), 0), (joined(far, near), 2)):
            face, _, _ = visible_faces(mesh.corners, FRONT)
            assert face[12, 16] in (first, first + 1)

    def test_a_floor_from_behind_the_camera_to_the_horizon(self) -> None:
        camera = look_at((0.0, 1.0, 0.0), (0.0, 1.0, -1.0), SIZE, 60.0)
        mesh = sheet(FLOOR)
        face, weights, inverse_depth = visible_faces(mesh.corners, camera)
        assert (face[:12] < 0).all()
        assert (face[13:] >= 0).all()
        points = np.einsum("hwc,hwcd->hwd", weights[13:], mesh.corners[face[13:]])
        # where a ray through the pixel's centre meets the floor
        depth = camera.fy / (np.arange(13, 24) + 0.5 - camera.cy)
        assert points[:, 5, 1] == pytest.approx(0.0, abs=1e-9)
        assert points[:, 5, 2] == pytest.approx(-depth, rel=1e-9)
        assert inverse_depth[13:, 5] == pytest.approx(1.0 / depth, rel=1e-9)

    def test_what_is_behind_does_not_show(self) -> None:
        face, _, _ = visible_faces(upright(1.0, 5.0).corners, FRONT)
        assert (face < 0).all()


class TestPicture:
    def test_sky_where_nothing_stands_and_light_on_what_does(self) -> None:
        room = dataclasses.replace(BARE, lamp=(0.0, 0.0, 4.0), sky=((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)))
        image = picture(upright(1.0, 0.0), room, FRONT)
        assert image.shape == (24, 32, 3)
        assert image.dtype == np.float32
        assert image[0, 0] == pytest.approx([0.0, 0.0, 1.0])
        red, green, blue = image[12, 16]
        assert red > green > blue > 0.0

    def test_layers_make_the_image_of_all(self) -> None:
        front, back = (
            sheet([[-1, -1, 0.5], [1, -1, 0.5], [1, 0, -2], [-1, 0, -2]], (0.1, 0.6, 0.2)),
            upright(1.0, -0.5),
        )
        whole = picture(joined(front, back), BARE, FRONT)
        for near, far in ((front, back), (back, front)):
            found = image(layer(near, BARE, FRONT, layer(far, BARE, FRONT)))
            assert found == pytest.approx(whole, abs=1e-6)

    def test_the_highlight_depends_on_the_place_of_the_camera(self) -> None:
        mesh = sheet(FLOOR, colour=(0.0, 0.0, 0.0))
        facing, aside = (
            look_at((x, 2.0, z), (0.0, 0.0, -1.0), SIZE, 40.0) for x, z in ((0.0, -2.0), (4.0, 3.0))
        )
        room = dataclasses.replace(BARE, lamp=(0.0, 2.0, 0.0))
        assert picture(mesh, room, facing)[12, 16].mean() > picture(mesh, room, aside)[12, 16].mean() + 0.02


class TestRooms:
    @pytest.mark.parametrize("name", ROOMS)
    def test_a_room_is_furnished_and_textured(self, name: str) -> None:
        mesh = room_mesh(ROOMS[name])
        assert len(ROOMS[name].pieces) >= 8
        assert len(mesh.corners) == len(mesh.primitive) == len(mesh.face) > 3000
        assert any(p.material.texture is not None for p in mesh.primitives)
        assert 6.0 < np.ptp(mesh.corners[:, :, 0]) < 35.0

    def test_no_file_lies_there_unused(self) -> None:
        """Each folder: its licence, the pieces of the rooms, and what these name."""
        used = {FOLDER / p.file for room in ROOMS.values() for p in room.pieces}
        used |= {actor_path(c.actor.asset) for c in CAPTURES.values()}
        text = "".join(path.read_text("latin-1") for path in used)
        for path in FOLDER.rglob("*.*"):
            assert path in used or path.name in text or path.name.startswith("LICENSE"), path

    def test_placed_turns_about_the_upright_axis(self) -> None:
        found = placed(np.array([[1.0, 1.0, 0.0]]), (0.0, 5.0, 0.0), 90.0, 2.0)
        assert found == pytest.approx(np.array([[0.0, 7.0, -2.0]]), abs=1e-12)

    @pytest.mark.parametrize("name", ["capture_kitchen", "capture_dungeon"])
    def test_somebody_moves(self, name: str) -> None:
        actor = CAPTURES[name].actor
        first, second = actor_meshes(actor, 2)
        moved = np.linalg.norm(second.corners - first.corners, axis=2)
        assert 0.002 < moved.max() < 0.5

    def test_an_actor_has_the_asked_size(self) -> None:
        actor: Actor = dataclasses.replace(CAPTURES["capture_kitchen"].actor, size=1.0)
        assert np.ptp(next(actor_meshes(actor, 1)).corners[:, :, 1]) == pytest.approx(1.0)


class TestRigs:
    def test_a_forward_rig_is_a_quarter_as_wide_as_its_distance(self) -> None:
        cameras = fitting_cameras(RIGS["forward"], SIZE)
        places = np.array([camera.position for camera in cameras])
        assert len(cameras) == 20
        width = np.linalg.norm(places[4] - places[0])
        assert width == pytest.approx(0.25 * RIGS["forward"].distance)
        assert np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-9) == 2

    def test_cameras_inside_stand_around_the_middle(self) -> None:
        rig = RIGS["inside"]
        cameras = fitting_cameras(rig, SIZE)
        assert 24 <= len(cameras) <= 32
        around = np.array([camera.position for camera in cameras]) - rig.target
        assert np.hypot(around[:, 0], around[:, 2]).max() == pytest.approx(3.0)
        angles = np.sort(np.arctan2(around[:14, 2], around[:14, 0]))
        assert np.diff(angles) == pytest.approx(2.0 * math.pi / 14)

    @pytest.mark.parametrize("kind", RIGS)
    def test_views_stand_between_the_cameras(self, kind: str) -> None:
        rig = RIGS[kind]
        fitting = np.array([camera.position for camera in fitting_cameras(rig, SIZE)])
        for camera in evaluation_cameras(rig, SIZE):
            distances = np.sort(np.linalg.norm(fitting - camera.position, axis=1))
            assert distances[0] > 0.03 * rig.distance
            assert (camera.position > fitting.min(axis=0) - 1e-9).all()
            assert (camera.position < fitting.max(axis=0) + 1e-9).all()

    def test_inria_poses_lead_back(self) -> None:
        for camera, entry in zip(
            fitting_cameras(RIGS["inside"], SIZE),
            inria_cameras(fitting_cameras(RIGS["inside"], SIZE)),
            strict=True,
        ):
            to_world = np.eye(4)
            to_world[:3, :3], to_world[:3, 3] = entry["rotation"], entry["position"]
            assert np.linalg.inv(to_world) == pytest.approx(camera.world_to_camera, abs=1e-12)
            assert (entry["fx"], entry["width"], entry["height"]) == (camera.fx, *SIZE)
