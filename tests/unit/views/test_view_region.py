"""The region in which viewers stand: given cameras, places between them, and a little outside."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dfcgs_codec import InputError
from dfcgs_codec.array_types import Float64
from dfcgs_codec.views.camera import ViewCamera, Views
from dfcgs_codec.views.region import positions_between, reach_of
from tests.unit.views.view_files import camera

SIZE = 10.0


def rectangle(columns: int = 5, rows: int = 4, spacing: float = 1.0) -> list[ViewCamera]:
    return [camera((x * spacing, y * spacing, 0)) for y in range(rows) for x in range(columns)]


def ring(count: int, radius: float, *, inward: bool) -> list[ViewCamera]:
    """Around the y axis, upright."""
    angles = 2 * np.pi * np.arange(count) / count
    turn = math.pi if inward else 0.0
    return [
        camera((radius * np.sin(a), 0, radius * np.cos(a)), (0, (a + turn) % (2 * math.pi), 0))
        for a in angles
    ]


def path(count: int) -> list[ViewCamera]:
    along = np.linspace(0, 1, count)
    return [camera((1000 * t, 5 * np.sin(7 * t), 0), (0, 0.3 * np.sin(5 * t), 0)) for t in along]


RIGS = {
    "one": [camera()],
    "two": rectangle(2, 1),
    "three": rectangle(3, 1),
    "rectangle": rectangle(),
    "its border": [c for c in rectangle(6, 5) if c.position[0] in (0, 5) or c.position[1] in (0, 4)],
    "inward": ring(30, 3, inward=True),
    "outward": ring(30, 0.5, inward=False),
    "one place": [camera((1, 2, 3), (0, a, 0)) for a in np.linspace(0, 6, 12)],
    "path": path(500),
    "map coordinates": [camera(c.position + np.array([4e5, 5e6, 100])) for c in rectangle()],
    "upside down": [camera((x, 0, 0), (0, 0, math.pi * (x % 2))) for x in range(4)],
}


def places(cameras: list[ViewCamera]) -> Float64:
    return np.array([found.position for found in cameras])


def between(rig: list[ViewCamera], count: int = 24, **options: float) -> list[ViewCamera]:
    return positions_between(Views(tuple(rig)), count, **({"scene_size": SIZE} | options))


@pytest.mark.parametrize("name", RIGS)
def test_of_every_rig(name: str) -> None:
    rig = RIGS[name]
    found = between(rig)
    assert found == between(rig)
    assert len(set(found)) == len(found)
    assert 10 < len(found) <= 24
    assert found[0] in rig
    for chosen in found:
        assert np.allclose(chosen.rotation @ chosen.rotation.T, np.eye(3))
        assert np.linalg.det(chosen.rotation) == pytest.approx(1)
    assert between(rig, 7) == found[:7]


@pytest.mark.parametrize("margin", [0.0, 0.15, 1.0])
@pytest.mark.parametrize("name", ["rectangle", "its border", "map coordinates", "two", "three"])
def test_inside_the_rectangle_grown_by_the_margin(name: str, margin: float) -> None:
    rig = RIGS[name]
    reach = reach_of(Views(tuple(rig)), margin=margin, scene_size=SIZE)
    assert (reach > 0) == (margin > 0)
    low, high = places(rig).min(axis=0), places(rig).max(axis=0)
    found = places(between(rig, 60, margin=margin))
    outside = np.linalg.norm(np.maximum(np.maximum(low - found, found - high), 0), axis=1)
    assert outside.max() == pytest.approx(reach, abs=1e-6)
    # most stand inside
    assert (outside > 1e-6).mean() < 0.35 or len(rig) < 4


def test_what_is_chosen_covers_the_rectangle() -> None:
    """No place of it is further from one that was chosen than about a camera's spacing."""
    grid = np.stack(np.meshgrid(np.linspace(0, 4, 33), np.linspace(0, 3, 25), [0.0]), axis=-1).reshape(-1, 3)

    def hole(count: int) -> float:
        apart = np.linalg.norm(grid[:, None] - places(between(rectangle(), count))[None], axis=2)
        return float(apart.min(axis=1).max())

    holes = [hole(count) for count in (1, 4, 8, 16, 24)]
    assert holes == sorted(holes, reverse=True)
    assert holes[1] < 2.3
    assert holes[2] < 1.6
    assert holes[4] < 0.85


def test_the_empty_middle_of_a_border_is_part_of_the_region() -> None:
    inner = [place for place in places(between(RIGS["its border"])) if 1 < place[0] < 4 and 1 < place[1] < 3]
    assert inner


def test_nobody_stands_in_the_middle_of_an_inward_ring() -> None:
    found = places(between(RIGS["inward"]))
    assert np.linalg.norm(found, axis=1).min() > 2.2


def test_cameras_between_look_between() -> None:
    rig = [camera((0, 0, 0), (0, -0.4, 0)), camera((1, 0, 0), (0, 0.4, 0))]
    middle = [c for c in between(rig) if np.allclose(c.position, (0.5, 0, 0))]
    assert len(middle) == 1
    assert np.allclose(middle[0].forward, (0, 0, 1), atol=1e-9)


def test_cameras_that_look_apart_are_no_neighbours() -> None:
    rig = [camera((0, 0, 0)), camera((1, 0, 0), (0, 1.2, 0))]
    assert all(not 0.2 < place[0] < 0.8 for place in places(between(rig)))


def test_duplicates_collapse() -> None:
    assert places(between(rectangle() * 3)).tolist() == places(between(rectangle())).tolist()


def test_a_path_stays_a_path() -> None:
    found = places(between(path(300), scene_size=200.0))
    assert np.ptp(found[:, 0]) > 950
    assert np.abs(found[:, 1:]).max() < 5 + reach_of(Views(tuple(path(300))), scene_size=200.0) + 1e-6


def test_the_margin_is_that_of_the_rig_not_of_its_number_of_cameras() -> None:
    sparse, dense = rectangle(5, 4), rectangle(17, 13, 0.25)
    reaches = [reach_of(Views(tuple(rig)), scene_size=SIZE) for rig in (sparse, dense)]
    assert reaches[1] == pytest.approx(reaches[0], rel=0.3)
    assert reach_of(Views(tuple(path(300))), scene_size=1.0) == pytest.approx(0.15)


def test_one_camera_moves_by_a_share_of_the_scene() -> None:
    shifts = np.linalg.norm(places(between([camera()], scene_size=80.0)), axis=1)
    assert shifts[0] == 0
    assert np.allclose(shifts[1:], 1.5)
    assert len(between([camera()], margin=0)) == 1
    assert len(between([camera()], scene_size=0)) == 1


def test_lenses_are_those_of_the_nearest() -> None:
    rig = [camera((x, 0, 0), size=(100 + x, 50)) for x in range(3)]
    for found in between(rig):
        assert abs(found.width - 100 - found.position[0]) <= 0.5 + 1e-9


def test_ten_thousand_cameras() -> None:
    assert len(between(path(10_000))) == 24


def test_arguments_out_of_range() -> None:
    for options in ({"count": 0}, {"margin": -1.0}, {"margin": math.nan}, {"scene_size": math.inf}):
        name = next(iter(options))
        with pytest.raises(InputError, match=f"{name}: found"):
            between([camera()], **options)  # type: ignore[arg-type]
