from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dfcgs_codec.errors import InputError
from lab.small_clouds import FIELDS, make_cloud, same_cloud


@pytest.mark.parametrize("degree", range(4))
def test_counts_come_from_the_arrays(degree: int) -> None:
    cloud = make_cloud(7, degree)
    assert (cloud.num_gaussians, cloud.sh_degree) == (7, degree)


@pytest.mark.parametrize("field", FIELDS[1:])
def test_a_length_other_than_that_of_positions_is_named(field: str) -> None:
    with pytest.raises(InputError, match=f"GaussianCloud.{field}: found"):
        replace(make_cloud(7), **{field: getattr(make_cloud(8), field)})


@pytest.mark.parametrize("field", FIELDS)
def test_a_wrong_dtype_is_named(field: str) -> None:
    cloud = make_cloud(3, 1)
    with pytest.raises(InputError, match=f"GaussianCloud.{field}: found float16"):
        replace(cloud, **{field: getattr(cloud, field).astype(np.float16)})


@pytest.mark.parametrize("field", FIELDS)
def test_doubles_are_taken(field: str) -> None:
    cloud = make_cloud(3, 1)
    wide = replace(cloud, **{field: getattr(cloud, field).astype(np.float64)})
    assert getattr(wide, field).dtype == np.float64
    assert same_cloud(wide.as_float32(), cloud)


@pytest.mark.parametrize("shape", [(3, 3, 4), (3, 3, 16), (3, 9), (3, 2, 3)])
def test_other_numbers_of_sh_coefficients_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="sh_rest"):
        replace(make_cloud(3), sh_rest=np.zeros(shape, np.float32))


def test_take_keeps_all_attributes_together() -> None:
    cloud = make_cloud(10, 2)
    order = np.array([3, 3, 9, 0])
    taken = cloud.take(order)
    for field in FIELDS:
        assert np.array_equal(getattr(taken, field), getattr(cloud, field)[order])
    assert same_cloud(cloud.take(np.arange(10)), cloud)
