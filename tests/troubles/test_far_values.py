"""One far Gaussian spoils nothing; maps, doubles, frames without Gaussians; values that no grid holds."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import (
    Bound,
    GaussianCloud,
    InputError,
    decode_sequence,
    encode_sequence,
)
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from dfcgs_codec.encoder.frame.report import EncodeReport
from lab.options import encoder_options
from lab.small_clouds import FIELDS, drifting, make_cloud, real_cloud, still
from tests.helpers import taking_turns

INPUT = OutputOrder.INPUT
NUM_FRAMES = 4


def coded(
    frames: list[GaussianCloud], tmp_path: Path, **options: object
) -> tuple[EncodeReport, list[GaussianCloud]]:
    target = tmp_path / "a.dgs"
    report = encode_sequence(frames, target, encoder_options(order=INPUT, **options), force=True)
    return report, [frame.cloud() for frame in decode_sequence(target)]


@pytest.fixture(scope="module")
def scene() -> list[GaussianCloud]:
    return drifting(real_cloud(1500), NUM_FRAMES)


@pytest.fixture(scope="module")
def plain(scene: list[GaussianCloud], tmp_path_factory: pytest.TempPathFactory) -> tuple[EncodeReport, float]:
    """Without a far Gaussian: the report, and the median error of positions of the others."""
    report, decoded = coded(scene, tmp_path_factory.mktemp("plain"))
    return report, median_error(scene, decoded)


@pytest.fixture(scope="module")
def gone(scene: list[GaussianCloud], tmp_path_factory: pytest.TempPathFactory) -> tuple[EncodeReport, float]:
    """The same without the Gaussian that others have far away."""
    others = [cloud.take(np.delete(np.arange(cloud.num_gaussians), 7)) for cloud in scene]
    report, decoded = coded(others, tmp_path_factory.mktemp("gone"))
    return report, median_error(others, decoded)


def median_error(frames: list[GaussianCloud], decoded: list[GaussianCloud]) -> float:
    apart = [np.abs(a.positions - b.positions).max(axis=1) for a, b in zip(frames, decoded, strict=True)]
    return float(np.median(apart))


FAR = [1e3, 1e5, 1e8, 1e12, 1e35]
WHERE = [(0,), (2,), (3,), (0, 1, 2, 3)]
#: those of `make test`; all others are slow
QUICK = {(1e3, WHERE[0]), (1e5, WHERE[1]), (1e8, WHERE[2]), (1e12, WHERE[3]), (1e35, WHERE[0])}


@pytest.mark.parametrize(
    ("far", "where"),
    [
        pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow, id=str(case))
        for case in itertools.product(FAR, WHERE)
    ],
)
def test_one_far_gaussian(
    far: float,
    where: tuple[int, ...],
    scene: list[GaussianCloud],
    plain: tuple[EncodeReport, float],
    gone: tuple[EncodeReport, float],
    tmp_path: Path,
) -> None:
    # all is planned from the first frame, as if who is far there were not
    expected = gone if 0 in where else plain
    frames = list(scene)
    for index in where:
        positions = frames[index].positions.copy()
        positions[7] = [far, -far, far / 2]
        frames[index] = replace(frames[index], positions=positions)
    report, decoded = coded(frames, tmp_path)
    assert report.num_bytes <= expected[0].num_bytes + 64 * NUM_FRAMES
    assert median_error(frames, decoded) <= 1.02 * expected[1]
    for index in where:
        assert np.allclose(decoded[index].positions[7], [far, -far, far / 2], rtol=1e-4)
    if far >= 1e8:
        assert any("kept exactly" in note for note in report.notes)
    assert report.num_escapes == 3 * len(where)


@pytest.mark.parametrize(
    ("field", "value"),
    [("scales", 1e9), ("scales", -1e30), ("opacities", 1e8), ("sh_dc", 1e10), ("sh_rest", -1e9)],
)
def test_one_value_beyond_its_grid_is_kept_exactly(
    field: str, value: float, scene: list[GaussianCloud], plain: tuple[EncodeReport, float], tmp_path: Path
) -> None:
    frames = list(scene)
    values = getattr(frames[1], field).copy()
    values.reshape(len(values), -1)[9, 0] = value
    frames[1] = replace(frames[1], **{field: values})
    report, decoded = coded(frames, tmp_path)
    assert getattr(decoded[1], field).reshape(len(values), -1)[9, 0] == np.float32(value)
    assert report.num_bytes <= plain[0].num_bytes + 64 * NUM_FRAMES
    assert report.errors["position"].maximum < 0.01


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_scene_in_map_coordinates_keeps_its_precision(
    dtype: type, scene: list[GaussianCloud], plain: tuple[EncodeReport, float], tmp_path: Path
) -> None:
    away = np.array([500_000, 4_600_000, -120])
    frames = [replace(f, positions=(f.positions.astype(np.float64) + away).astype(dtype)) for f in scene]
    report, decoded = coded(frames, tmp_path)
    assert decoded[0].positions.dtype == dtype
    assert not report.notes
    spacing = float(np.spacing(dtype(4_600_000)))
    assert median_error(frames, decoded) <= max(1.05 * plain[1], spacing)
    assert report.num_bytes <= 1.02 * plain[0].num_bytes


def test_a_bound_is_kept_against_doubles(scene: list[GaussianCloud], tmp_path: Path) -> None:
    frames = [replace(f, positions=f.positions.astype(np.float64) / 3) for f in scene[:2]]
    report, decoded = coded(frames, tmp_path, bounds=(Bound("position", 1e-8),))
    worst = max(
        np.linalg.norm(a.positions - b.positions, axis=1).max() for a, b in zip(frames, decoded, strict=True)
    )
    assert worst <= 1e-8
    assert report.errors["position"].maximum == pytest.approx(worst)


@pytest.mark.parametrize("gof_size", [1, None])
def test_verbatim_frames_keep_every_bit(gof_size: int | None, tmp_path: Path) -> None:
    frames = [not_finite(cloud) for cloud in drifting(make_cloud(60, 2), 3)]
    report, decoded = coded(frames, tmp_path, intra=IntraKind.PLY, gof_size=gof_size)
    for index, (source, found) in enumerate(zip(frames, decoded, strict=True)):
        for name in FIELDS:
            a, b = getattr(source, name).view("u4"), getattr(found, name).view("u4")
            odd = ~np.isfinite(getattr(source, name))
            assert np.array_equal(
                a if gof_size or not index else a[odd], b if gof_size or not index else b[odd]
            )
    assert all(np.isfinite(error.maximum) for error in report.errors.values())


def not_finite(cloud: GaussianCloud) -> GaussianCloud:
    arrays = {name: getattr(cloud, name).copy() for name in FIELDS}
    arrays["positions"][3] = [np.nan, 1, np.inf]
    arrays["positions"].view("u4")[20, 0] = 0x7F800123
    arrays["scales"][5], arrays["opacities"][7], arrays["opacities"][8] = -np.inf, np.inf, -np.inf
    arrays["rotations"][9], arrays["rotations"][10, 1] = 0, np.nan
    arrays["sh_rest"][12, 1, 2] = -np.inf
    return GaussianCloud(**arrays)


@pytest.mark.parametrize("field", ["positions", "scales", "sh_rest"])
def test_coded_frames_refuse_what_is_not_finite(field: str, tmp_path: Path) -> None:
    cloud = make_cloud(20, 1)
    values = getattr(cloud, field).copy()
    values[4] = np.nan
    with pytest.raises(InputError, match="NaN"):
        coded([replace(cloud, **{field: values})], tmp_path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("case", "qp"),
    taking_turns(
        [
            ({"positions": 1e-30}, "multiply positions"),
            ({"positions": 1e-42}, "multiply positions"),
            ({"positions": 0.0}, ""),
            ({"positions": 1e20}, ""),
            ({"positions": 1e33}, "scenes up to"),
            ({"scales": 20.0}, ""),
            ({"scales": 1e30}, ""),
            ({"sh_dc": 1e30}, ""),
            ({"opacities": 1e30}, ""),
            ({"rotations": 1e-40}, ""),
            ({"rotations": 1e30}, ""),
        ],
        (0, 51),
    ),
    ids=str,
)
def test_numbers_at_the_end_of_floats(case: tuple[dict[str, float], str], qp: float, tmp_path: Path) -> None:
    """Coded, or refused in words; no warning of numpy's, no traceback."""
    changes, words = case
    cloud = make_cloud(300, 1)
    changed = {name: getattr(cloud, name) * np.float32(by) for name, by in changes.items()}
    frames = (
        drifting(replace(cloud, **changed), 2)
        if "positions" not in changes
        else still(replace(cloud, **changed), 2)
    )
    refused = pytest.raises(InputError, match=words) if words else contextlib.nullcontext()
    with refused:
        coded(frames, tmp_path, qp=qp)
