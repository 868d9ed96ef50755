"""The symbol walk of `ply` I-frames: float32 bits, lossless (spec annex A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dfcgs_codec.array_types import Float32, Floats, Int64, UInt8
from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.columns.coder import SymbolCoder
from dfcgs_codec.codec.columns.column import code_permutation
from dfcgs_codec.codec.state.planes import SH_BANDS, FrameState, Plane, sh_bands, sh_rest_of_bands
from dfcgs_codec.entropy.symbols import Groups, code_bits, code_with_models
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.companding import compress
from dfcgs_codec.transform.lod import order_levels
from dfcgs_codec.transform.rotation import from_float

_BYTE = 256
_NUM_CONTEXTS = 8


def _middle_exponent(top: Int64) -> int:
    return int(np.median(top & 0x7F))


def _exponent_contexts(top: Int64, center: int) -> UInt8:
    """Contexts of the second byte: where the exponent's upper seven bits lie around `center`."""
    half = _NUM_CONTEXTS // 2
    step = np.clip((top & 0x7F) - center, -half, half - 1) + half
    return np.asarray(step, np.uint8)


def _code_plane(coder: SymbolCoder, values: Int64 | None, contexts: UInt8) -> Int64:
    """Bytes with a histogram per context, or raw where that is as good."""
    count = len(contexts)
    known = np.zeros(0, np.int64) if values is None else values

    def is_structured() -> int:
        cells = np.bincount(contexts.astype(np.int64) * _BYTE + known, minlength=_NUM_CONTEXTS * _BYTE)
        table = cells.reshape(-1, _BYTE).astype(np.float64)
        total = np.maximum(table.sum(axis=1, keepdims=True), 1)
        entropy = -(table * np.log2(np.maximum(table, 1) / total)).sum()
        # what the histograms themselves cost: about 20 bits per byte value seen, one bit per one not
        side = 20 * np.count_nonzero(table) + _BYTE * len(np.unique(contexts)) + 64
        return int(entropy + side < 8 * count)

    if not coder.choice(2, is_structured):
        return code_bits(coder, values, 8, count)
    groups = Groups(contexts, _NUM_CONTEXTS)
    models = coder.histograms(groups.used, _NUM_CONTEXTS, _BYTE, lambda: (known, contexts))
    return code_with_models(coder, values, groups, models)


def code_float_column(coder: SymbolCoder, target: Float32 | None, count: int) -> Float32:
    """One float32 column (N,), byte by byte from the top: sign and exponent first."""
    bits = None
    if target is not None:
        bits = np.ascontiguousarray(target, "<f4").view("<u4").astype(np.int64)
    result = np.zeros(count, np.int64)
    contexts = np.zeros(count, np.uint8)
    for shift in (24, 16, 8, 0):
        part = None if bits is None else bits >> shift & (_BYTE - 1)
        plane = _code_plane(coder, part, contexts)
        result |= plane << shift
        contexts = np.zeros(count, np.uint8)
        if shift == 24:
            center = coder.choice(_BYTE, partial(_middle_exponent, plane))
            contexts = _exponent_contexts(plane, center)
    return result.astype("<u4").view("<f4").astype(np.float32)


@dataclass(frozen=True)
class VerbatimSymbols:
    """What a `ply` I-frame carries: columns (N, C) float32 of each attribute, and the output order."""

    columns: list[Float32]
    permutation: Int64 | None


def code_verbatim(
    next_coder: Callable[[], SymbolCoder],
    symbols: VerbatimSymbols | None,
    widths: list[int],
    shape: tuple[int, bool],
) -> VerbatimSymbols:
    """All streams of a `ply` I-frame; `widths` are the C, `shape` is N and has_permutation.

    Positions come as floats here, so neighbours are weighted by order alone.
    """
    count, has_permutation = shape
    lod = order_levels(count)
    permutation = None
    result = []
    for index, width in enumerate(widths):
        coder = next_coder()
        known = None if symbols is None else symbols.columns[index]
        columns = [
            code_float_column(coder, None if known is None else known[:, c], count) for c in range(width)
        ]
        result.append(np.stack(columns, axis=1))
        if index == 0 and has_permutation:
            given = None if symbols is None else symbols.permutation
            permutation = code_permutation(next_coder(), given, lod, np.zeros(count, np.int64))
    return VerbatimSymbols(result, permutation)


def state_of_columns(symbols: VerbatimSymbols, units: UnitExponents) -> FrameState:
    """The state that a `ply` I-frame leaves behind."""
    state = state_of(cloud_of_columns(symbols.columns), units)
    permutation = symbols.permutation
    return replace(state, order=None if permutation is None else Plane(permutation[:, None]))


def cloud_of_columns(columns: list[Float32]) -> GaussianCloud:
    """Inverse of `dpb.verbatim_columns`."""
    n = len(columns[0])
    sh_rest = sh_rest_of_bands(columns[5:], n)
    return GaussianCloud(columns[0], columns[2], columns[1], columns[3][:, 0], columns[4], sh_rest)


def _to_grid(values: Floats, exponent: int, origin: tuple[int, ...] = (0,)) -> Int64:
    # exact up to the one rounding of rint; clipped before the cast, so that it is within range
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.rint(np.ldexp(values.astype(np.float64), -exponent))
    if any(origin):
        scaled -= np.array(origin, np.float64)
    known = np.where(np.isnan(scaled), 0.0, scaled)
    return np.clip(known, -STATE_LIMIT, STATE_LIMIT).astype(np.int64)


def _known_rotations(rotations: Floats) -> Floats:
    """Those that are no quaternion, not finite or zero, as no rotation."""
    unknown = ~np.isfinite(rotations).all(axis=1) | (rotations == 0).all(axis=1)
    if not unknown.any():
        return rotations
    return np.where(unknown[:, None], np.array([1, 0, 0, 0], rotations.dtype), rotations)


def grid_values(cloud: GaussianCloud, field: str, units: UnitExponents) -> dict[Attribute, Int64]:
    """Integers (N, C) of the attributes that one array of `cloud` holds, on their grids."""
    values = getattr(cloud, field)
    if field == "positions":
        return {Attribute.POSITION: _to_grid(values, units.position, units.origin)}
    if field == "sh_rest":
        bands = zip(SH_BANDS, sh_bands(values), strict=False)
        return {attribute: _to_grid(band, units.color) for attribute, band in bands}
    if field == "rotations":
        return {Attribute.ROTATION: from_float(_known_rotations(values))}
    if field == "opacities":
        return {Attribute.OPACITY: compress(_to_grid(values, units.opacity), units.opacity)[:, None]}
    attribute, exponent = {
        "scales": (Attribute.SCALE, units.scale),
        "sh_dc": (Attribute.SH_DC, units.color),
    }[field]
    return {attribute: _to_grid(values, exponent)}


def state_of(cloud: GaussianCloud, units: UnitExponents) -> FrameState:
    """Integer state of float values: the reference that a `ply` I-frame leaves behind (spec annex A.3)."""
    planes: dict[Attribute, Int64] = {}
    for field in ("positions", "scales", "rotations", "opacities", "sh_dc", "sh_rest"):
        planes |= grid_values(cloud, field, units)
    return FrameState({a: Plane(values) for a, values in planes.items()}, verbatim=cloud)
