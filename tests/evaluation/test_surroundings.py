from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bjontegaard")
pytest.importorskip("numba")

from evaluation.experiments.i_frames import surroundings
from evaluation.tables import intra as intra_tables
from lab.scenes import SURROUNDINGS
from lab.scenes.fields import scene_size
from lab.scenes.rotations import to_matrices
from lab.scenes.surroundings import ROOM_SIZE, in_a_room
from lab.small_clouds import FIELDS, real_cloud


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_the_object_stays_as_it_is(name: str) -> None:
    cloud = real_cloud(400)
    found = SURROUNDINGS[name](cloud, 1)
    assert found.num_gaussians > 400
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(found, field)[:400], getattr(cloud, field))
        assert np.isfinite(getattr(found, field)).all()
    again, other = SURROUNDINGS[name](cloud, 1), SURROUNDINGS[name](cloud, 2)
    np.testing.assert_array_equal(again.positions, found.positions)
    assert not np.array_equal(other.positions, found.positions)


def test_walls_are_flat_and_face_the_room() -> None:
    cloud = real_cloud(300)
    room = in_a_room(cloud, 0)
    middle = np.median(cloud.positions, axis=0)
    half = 0.5 * ROOM_SIZE * scene_size(cloud.positions)
    offsets = (room.positions[300:] - middle) / half
    np.testing.assert_allclose(np.abs(offsets).max(axis=1), 1.0, atol=1e-4)
    thin = to_matrices(room.rotations[300:].astype(np.float64))[:, :, 0]
    wall = np.abs(offsets).argmax(axis=1)
    np.testing.assert_allclose(np.abs(thin[np.arange(300), wall]), 1.0, atol=1e-4)


def test_variants_are_compared_at_equal_psnr(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surroundings, "SEEDS", (0,))
    monkeypatch.setattr(surroundings, "QPS", (20, 28))
    monkeypatch.setattr(surroundings, "_SIZE", (64, 48))
    found = surroundings.compare(real_cloud(500), "haze")
    assert found["num_gaussians"] == 505
    fine, coarse = found["default"]["points"]
    assert fine["bytes"] > coarse["bytes"]
    assert fine["psnr"] > coarse["psnr"]
    assert found["default"]["bd_rate"] == pytest.approx(0.0, abs=1e-9)
    assert found["uniform"]["bd_rate"] != 0.0
    monkeypatch.setattr(intra_tables, "results", lambda _: {"splat": {"haze": found}})
    assert "| splat | haze | 505 |" in intra_tables.surroundings_table()
