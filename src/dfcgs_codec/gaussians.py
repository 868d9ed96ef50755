"""The data model: one frame of 3D Gaussians, as float arrays.

Shapes, dtypes and spaces are stated here and nowhere else:

    positions  (N, 3)     scene units
    rotations  (N, 4)     quaternion w, x, y, z; any length but zero
    scales     (N, 3)     natural logarithm of the standard deviation, scene units
    opacities  (N,)       logit of alpha
    sh_dc      (N, 3)     SH degree 0 coefficient of red, green, blue
    sh_rest    (N, 3, K)  higher SH coefficients, channel first as in the PLY;
                          K = 0, 3, 8, 15 for SH degree 0, 1, 2, 3

Each is float32, or float64 where its file has doubles; N may be 0.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dfcgs_codec.array_types import AnyArray, Floats, Int64
from dfcgs_codec.errors import InputError

#: number of higher SH coefficients per colour channel, indexed by SH degree
SH_REST_COEFFICIENTS = (0, 3, 8, 15)


def _array(name: str, values: Any) -> AnyArray:
    """`values` as a plain array in this machine's byte order: of lists, of tensors in main memory.

    Its type of numbers stays what it is. InputError for what is no array, and for masked values.
    """
    if type(values) is np.ndarray and values.dtype.isnative and values.ndim:
        return values
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(
            f"GaussianCloud.{name}: a {type(values).__name__} that is no array: {error}"
        ) from None
    if not array.ndim:
        raise InputError(f"GaussianCloud.{name}: found a {type(values).__name__}, expected a numpy array")
    if np.ma.is_masked(values):
        raise InputError(f"GaussianCloud.{name}: masked values; take() or fill in what is to be coded")
    return array.astype(array.dtype.newbyteorder("="), copy=False)


@dataclass(frozen=True, eq=False)
class GaussianCloud:
    """One frame; the arrays are described at the top of this module."""

    positions: Floats
    rotations: Floats
    scales: Floats
    opacities: Floats
    sh_dc: Floats
    sh_rest: Floats

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _array(field.name, getattr(self, field.name)))
        n = len(self.positions)
        k = self.sh_rest.shape[-1] if self.sh_rest.ndim == 3 else -1
        expected = {
            "positions": (n, 3),
            "rotations": (n, 4),
            "scales": (n, 3),
            "opacities": (n,),
            "sh_dc": (n, 3),
            "sh_rest": (n, 3, k),
        }
        for name, shape in expected.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype not in (np.float32, np.float64):
                raise InputError(
                    f"GaussianCloud.{name}: found {array.dtype} {array.shape}, "
                    f"expected float32 or float64 {shape}"
                )
        if k not in SH_REST_COEFFICIENTS:
            raise InputError(
                f"GaussianCloud.sh_rest: {k} coefficients per channel, expected one of {SH_REST_COEFFICIENTS}"
            )

    @property
    def num_gaussians(self) -> int:
        """N."""
        return len(self.positions)

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return SH_REST_COEFFICIENTS.index(self.sh_rest.shape[2])

    def as_float32(self) -> GaussianCloud:
        """The same, every array rounded to float32."""
        return GaussianCloud(*(array.astype(np.float32, copy=False) for array in self._arrays))

    def take(self, index: Int64) -> GaussianCloud:
        """The Gaussians `index`, in that order."""
        return GaussianCloud(*(array[index] for array in self._arrays))

    @property
    def _arrays(self) -> list[Floats]:
        return [getattr(self, field.name) for field in fields(self)]
