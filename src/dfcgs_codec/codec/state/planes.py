"""The decoded picture buffer: integer state of frames, its hash, and the output process (spec section 8)."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dfcgs_codec.array_types import Float32, Floats, Int32, Int64, Integers
from dfcgs_codec.bitstream.constants import (
    FRAME_HASH_BYTES,
    ROTATION_FRACTION_BITS,
    STATE_COLUMNS,
    STATE_LIMIT,
    Attribute,
    Precision,
)
from dfcgs_codec.bitstream.escapes import Escapes
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.errors import CorruptBitstream
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud
from dfcgs_codec.transform.companding import expand

SH_BANDS = (Attribute.SH_1, Attribute.SH_2, Attribute.SH_3)


def _to_float(values: Integers, exponent: int) -> Float32:
    # exact: |value| < 2**29 and a power of two fit float64, and one rounding leads to float32
    return np.ldexp(values.astype(np.float64), exponent).astype(np.float32)


class Plane:
    """One attribute of all Gaussians, int32 (N, C), with its digest computed at most once."""

    def __init__(self, values: Integers) -> None:
        self.values: Int32 = np.ascontiguousarray(values, np.int32)
        self.values.setflags(write=False)
        self._digest: bytes | None = None
        self._floats: tuple[int, Float32] | None = None
        #: of the first SH band: exponent, identities of the other bands, all joined, the other bands
        self.joined: tuple[int, list[int], Float32, list[Plane]] | None = None

    @property
    def digest(self) -> bytes:
        """BLAKE2b, 128 bits, of the little-endian values."""
        if self._digest is None:
            data = self.values.astype("<i4", copy=False)
            self._digest = hashlib.blake2b(data.data, digest_size=FRAME_HASH_BYTES).digest()
        return self._digest

    def floats(self, exponent: int) -> Float32:
        """The values times 2**exponent, computed at most once; exact but for one rounding to float32."""
        if self._floats is None or self._floats[0] != exponent:
            floats = _to_float(self.values, exponent)
            floats.setflags(write=False)
            self._floats = (exponent, floats)
        return self._floats[1]

    def wide(self) -> Int64:
        """The values as int64, for arithmetic."""
        return self.values.astype(np.int64)


@dataclass(frozen=True)
class FrameState:
    """Integer state of one frame: a plane per attribute, in the order of its GoF.

    POSITION (N, 3), SCALE (N, 3), ROTATION (N, 4) unit quaternion w x y z in Q1.24, OPACITY (N, 1)
    companded, SH_DC (N, 3), SH_1, SH_2, SH_3 (N, 9), (N, 15), (N, 21): coefficient by coefficient, red,
    green, blue within.
    `order` (N, 1) is the place of each Gaussian in the output, or None when they come as they are.
    `verbatim` holds the float32 frame of a `ply` I-frame, in GoF order; `escapes` are values that the grids
    do not hold. `cover` int64 (N,) are the cover classes of a coded I-frame and of what follows it; they
    are no part of the hash.
    """

    planes: dict[Attribute, Plane]
    order: Plane | None = None
    verbatim: GaussianCloud | None = field(default=None, compare=False)
    cover: Int64 | None = field(default=None, compare=False)
    escapes: Escapes | None = field(default=None, compare=False)

    def on_grid(self) -> FrameState:
        """Without what P-frames do not refer to: float32 values and escapes."""
        if self.verbatim is None and self.escapes is None:
            return self
        return replace(self, verbatim=None, escapes=None)

    def take(self, rows: Int64) -> FrameState:
        """Some of the Gaussians, their places in the output closed up."""
        planes = {attribute: Plane(plane.values[rows]) for attribute, plane in self.planes.items()}
        order = None if self.order is None else Plane(ranks(self.order.values[rows, 0])[:, None])
        cover = None if self.cover is None else self.cover[rows]
        return FrameState(planes, order, cover=cover)

    def merge(self, births: FrameState, source: Int64) -> FrameState:
        """With `births`: row i of the result is row source[i] of these and those.

        In the output they come behind all others, where places are kept at all.
        """
        planes = {
            attribute: Plane(np.concatenate([plane.values, births.planes[attribute].values])[source])
            for attribute, plane in self.planes.items()
        }
        cover = None
        if self.cover is not None or births.cover is not None:
            cover = np.concatenate([self.covers(), births.covers()])[source]
        if self.order is None:
            return FrameState(planes, cover=cover)
        behind = np.arange(len(self.order.values), len(source))
        places = np.concatenate([self.order.values[:, 0], behind])[source]
        return FrameState(planes, Plane(places[:, None]), cover=cover)

    def covers(self) -> Int64:
        """`cover`, 0 where there is none."""
        return np.zeros(self.num_gaussians, np.int64) if self.cover is None else self.cover

    @property
    def num_gaussians(self) -> int:
        """N."""
        return len(self.planes[Attribute.POSITION].values)

    def hash(self) -> bytes:
        """Decoded-frame hash: BLAKE2b, 128 bits, over the planes' digests (spec section 8.5)."""
        digest = hashlib.blake2b(digest_size=FRAME_HASH_BYTES)
        for attribute in sorted(self.planes):
            digest.update(self.planes[attribute].digest)
        if self.order is not None:
            digest.update(self.order.digest)
        if self.verbatim is not None:
            for array in verbatim_columns(self.verbatim):
                digest.update(array.astype("<f4", copy=False).tobytes())
        if self.escapes is not None and len(self.escapes):
            digest.update(self.escapes.payload())
        return digest.digest()


def empty_state(attributes: list[Attribute]) -> FrameState:
    """That of a frame without Gaussians."""
    return FrameState({a: Plane(np.zeros((0, STATE_COLUMNS[a]), np.int32)) for a in attributes})


def ranks(places: Integers) -> Int64:
    """Rank of each of N different integers: 0 for the smallest."""
    result = np.empty(len(places), np.int64)
    result[np.argsort(places, kind="stable")] = np.arange(len(places))
    return result


def verbatim_columns(cloud: GaussianCloud) -> list[Float32]:
    """The frame's values as a list of (N, C) arrays in coding order of the attributes."""
    n = cloud.num_gaussians
    columns = [cloud.positions, cloud.scales, cloud.rotations, cloud.opacities.reshape(n, 1), cloud.sh_dc]
    return columns + sh_bands(cloud.sh_rest)


def sh_bands(sh_rest: Float32) -> list[Float32]:
    """Columns of SH degree 1, 2, 3, as far as there are, of `sh_rest` (N, 3, K)."""
    ends = SH_REST_COEFFICIENTS[: SH_REST_COEFFICIENTS.index(sh_rest.shape[2]) + 1]
    return [
        sh_rest[:, :, start:end].transpose(0, 2, 1).reshape(len(sh_rest), 3 * (end - start))
        for start, end in itertools.pairwise(ends)
    ]


def sh_rest_of_bands(bands: list[Float32], count: int) -> Float32:
    """Inverse of `sh_bands`; `count` is N."""
    columns = np.concatenate([np.zeros((count, 0), np.float32), *bands], axis=1)
    return np.ascontiguousarray(columns.reshape(count, columns.shape[1] // 3, 3).transpose(0, 2, 1))


def output(state: FrameState, units: UnitExponents) -> GaussianCloud:
    """The output process: the frame of a state in floats, in output order (spec section 8.4).

    Positions are float64 where `units` have that precision, all else is float32.
    """
    cloud = state.verbatim if state.verbatim is not None else _expand(state, units)
    if units.precision == Precision.FLOAT64:
        cloud = replace(cloud, positions=cloud.positions.astype(np.float64))
    if state.escapes is not None:
        cloud = _escaped(cloud, state.escapes)
    if state.order is None:
        return cloud
    source = np.empty(state.num_gaussians, np.int64)
    source[state.order.values[:, 0]] = np.arange(state.num_gaussians)
    return cloud.take(source)


#: first column of each attribute in a row of all of them
_FIRST_COLUMNS = dict(
    zip(STATE_COLUMNS, itertools.accumulate(STATE_COLUMNS.values(), initial=0), strict=False)
)
_FIELD_COLUMNS = {
    "positions": _FIRST_COLUMNS[Attribute.POSITION],
    "scales": _FIRST_COLUMNS[Attribute.SCALE],
    "rotations": _FIRST_COLUMNS[Attribute.ROTATION],
    "opacities": _FIRST_COLUMNS[Attribute.OPACITY],
    "sh_dc": _FIRST_COLUMNS[Attribute.SH_DC],
    "sh_rest": _FIRST_COLUMNS[Attribute.SH_1],
}


def columns_of(cloud: GaussianCloud) -> Iterator[tuple[str, int, Floats]]:
    """Field, first column in a row of all attributes, and values (N, C) with the columns of the state.

    The values are a view of the cloud's array, but for `sh_rest`, whose columns come in another order.
    """
    for name, first in _FIELD_COLUMNS.items():
        values = getattr(cloud, name)
        if name == "sh_rest":
            values = values.transpose(0, 2, 1)
        yield name, first, values.reshape(cloud.num_gaussians, math.prod(values.shape[1:]))


def _escaped(cloud: GaussianCloud, escapes: Escapes) -> GaussianCloud:
    """With the exact values of `escapes` in their places."""
    found = {}
    for name, first, values in columns_of(cloud):
        width = values.shape[1]
        some = (escapes.columns >= first) & (escapes.columns < first + width)
        if not some.any():
            continue
        bits = np.array(values).view(f"u{values.itemsize}")
        bits[escapes.rows[some], escapes.columns[some] - first] = escapes.patterns[some]
        found[name] = array_of_columns(name, bits.view(values.dtype), getattr(cloud, name).shape)
    return replace(cloud, **found)


def array_of_columns(name: str, values: Floats, shape: tuple[int, ...]) -> Floats:
    """Inverse of `columns_of` for one field: (N, C) in the shape of the cloud's array."""
    if name != "sh_rest":
        return values.reshape(shape)
    return np.ascontiguousarray(values.reshape(shape[0], shape[2], shape[1]).transpose(0, 2, 1))


def _joined(bands: list[Plane], count: int, exponent: int) -> Float32:
    """All SH above degree 0 of `count` Gaussians; not computed again while the planes are the same."""
    if not bands:
        return sh_rest_of_bands([], count)
    known = bands[0].joined
    if known is None or known[0] != exponent or [id(band) for band in bands[1:]] != known[1]:
        joined = sh_rest_of_bands([band.floats(exponent) for band in bands], count)
        joined.setflags(write=False)
        # the planes behind the first one are kept alive, so that their identities stay theirs
        bands[0].joined = known = (exponent, [id(band) for band in bands[1:]], joined, bands[1:])
    return known[2]


def _positions(plane: Plane, units: UnitExponents) -> Floats:
    """Positions with their origin: exact in float64, then one rounding where they come out as float32."""
    if units.origin == (0, 0, 0) and units.precision == Precision.FLOAT32:
        return plane.floats(units.position)
    sums = (plane.wide() + np.array(units.origin, np.int64)).astype(np.float64)
    values = np.ldexp(sums, units.position)
    return values if units.precision == Precision.FLOAT64 else values.astype(np.float32)


def _expand(state: FrameState, units: UnitExponents) -> GaussianCloud:
    n = state.num_gaussians
    planes = state.planes
    logits = expand(planes[Attribute.OPACITY].wide()[:, 0], units.opacity)
    bands = [planes[a] for a in SH_BANDS if a in planes]
    return GaussianCloud(
        positions=_positions(planes[Attribute.POSITION], units),
        rotations=planes[Attribute.ROTATION].floats(-ROTATION_FRACTION_BITS),
        scales=planes[Attribute.SCALE].floats(units.scale),
        opacities=_to_float(logits, units.opacity),
        sh_dc=planes[Attribute.SH_DC].floats(units.color),
        sh_rest=_joined(bands, n, units.color),
    )


def scaled(symbols: Int64, step: int) -> Int64:
    """Symbols times step; refused before they could leave 64 bits."""
    limit = 2 * STATE_LIMIT // step
    if len(symbols) and (symbols.min() < -limit or symbols.max() > limit):
        raise CorruptBitstream("a symbol is too large for its step")
    return symbols * step
