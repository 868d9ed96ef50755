from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec import Bound
from dfcgs_codec.encoder.frame.report import EncodeReport, ErrorStatistics, FrameRecord, attribute_errors
from dfcgs_codec.errors import InputError
from lab.small_clouds import make_cloud
from tests.helpers import alphas, rotation_degrees

A, B = make_cloud(50, 2, 1), make_cloud(50, 2, 2)


def test_errors_are_in_their_units() -> None:
    errors = attribute_errors(A, B)
    assert np.allclose(errors["position"], np.linalg.norm(A.positions - B.positions, axis=1), rtol=1e-5)
    assert np.allclose(errors["rotation"], rotation_degrees(A, B), atol=1e-3)
    assert np.allclose(errors["scale"], np.abs(A.scales - B.scales))
    assert np.allclose(errors["alpha"], np.abs(alphas(A) - alphas(B)))
    assert np.allclose(errors["colour"], np.abs(A.sh_dc - B.sh_dc) * 0.28209479)
    assert np.allclose(errors["sh"], np.abs(A.sh_rest - B.sh_rest))


def test_equal_frames_have_no_errors() -> None:
    for errors in attribute_errors(A, A).values():
        assert errors.max() == 0


def test_the_sign_and_length_of_a_quaternion_do_not_count() -> None:
    other = replace(A, rotations=A.rotations * np.float32(-4))
    assert attribute_errors(A, other)["rotation"].max() == 0


def test_tiny_angles_are_measured() -> None:
    one = replace(make_cloud(1), rotations=np.array([[1, 0, 0, 0]], np.float32))
    turned = replace(one, rotations=np.array([[1, 1e-6, 0, 0]], np.float32))
    assert attribute_errors(one, turned)["rotation"][0] == pytest.approx(np.degrees(2e-6), rel=1e-3)


def test_statistics() -> None:
    statistics, other = ErrorStatistics(), ErrorStatistics()
    assert statistics.mean == 0
    statistics.add(np.array([1.0, 3.0]))
    statistics.add(np.zeros((0, 3)))
    other.add(np.array([8.0]))
    statistics.merge(other)
    assert (statistics.maximum, statistics.mean, statistics.count) == (8.0, 4.0, 3)


def report(*, scale_error: float = 0.0) -> EncodeReport:
    found = EncodeReport()
    decoded = replace(A, scales=A.scales + np.float32(scale_error))
    measured = {}
    for name, errors in attribute_errors(A, decoded).items():
        measured[name] = ErrorStatistics()
        measured[name].add(errors)
    found.add_frame(FrameRecord(3, "I", 50, 100), measured)
    return found


def test_merge_appends_frames_and_joins_errors() -> None:
    first, second = report(), report(scale_error=0.5)
    second.notes.append("note")
    first.merge(second)
    assert [frame.number for frame in first.frames] == [3, 3]
    assert first.errors["scale"].maximum == pytest.approx(0.5, rel=1e-3)
    assert first.errors["scale"].mean == pytest.approx(0.25, rel=1e-3)
    assert first.notes == ["note"]


def test_a_bound_that_was_not_kept_is_refused() -> None:
    found = report(scale_error=0.5)
    found.check_bounds([Bound("scale", 0.6), Bound("position", 1e-9)])
    with pytest.raises(InputError, match=r"--bound scale=0\.4 cannot be kept: 0\.5"):
        found.check_bounds([Bound("scale", 0.4)])
