"""The figures of the profile `paper`: how they are made, and that those in the repository keep the bars."""

from __future__ import annotations

import pytest

pytest.importorskip("numba")
pytest.importorskip("bjontegaard")

from evaluation.experiments.paper.profile import ALLOWANCE, SETTINGS, least_gain
from evaluation.tables import paper as paper_tables
from lab.record import results
from lab.scenes.catalogue import group


def test_the_least_gain_is_that_of_the_worst_frame() -> None:
    assert least_gain([30.0, 25.0, 28.0], [29.0, 25.5, 20.0]) == -0.5
    assert least_gain([None, 30.0], [40.0, 29.0]) == 1.0
    assert least_gain([None], [None]) == 0.0
    assert least_gain([40.0], [None]) == -59.0


def test_no_frame_falls_behind_the_one_before() -> None:
    found = results("paper_profile")
    assert set(found) == {scene.name for scene in group("evaluation")}
    for name, scene in found.items():
        # settings of an older bitstream, which nothing measures any more, stand beside
        assert set(scene["settings"]) >= set(SETTINGS)
        for setting, row in scene["settings"].items():
            if setting.startswith("paper, ") and setting != "paper, refined":
                assert row["least_gain"] >= -ALLOWANCE, (name, setting)


def test_p_frames_alone_differ() -> None:
    for scene in results("paper_profile").values():
        settings = scene["settings"]
        intra = {
            settings[name]["bytes_by_chunk_type"]["INTRA_FRAME"]
            for name in ("paper, q' = 1", "paper, q' = 4", "paper, refined")
            if set(settings[name]["frame_types"][1:]) <= {"P", "s"}
        }
        assert len(intra) <= 1


def test_tables_have_a_row_for_each_scene_and_setting() -> None:
    scenes = results("paper_profile")
    for table in (paper_tables.curves_table(), paper_tables.whole_table()):
        assert [line.split("|")[1].strip() for line in table.splitlines()[2:]] == list(scenes)
    found = results("paper_ablations")
    text = paper_tables.ablation_table()
    for setting in {name for scene in found.values() for name in scene}:
        assert f"| {setting} |" in text
