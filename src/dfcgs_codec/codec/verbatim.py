"""The symbol walk of `ply` I-frames: float32 bits, lossless (spec section 13)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dfcgs_codec.bitstream.constants import STATE_LIMIT, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.component import EarlierPasses, code_component
from dfcgs_codec.codec.dpb import SH_BANDS, FrameState, Plane, sh_bands, sh_rest_of_bands
from dfcgs_codec.codec.intra import code_permutation
from dfcgs_codec.codec.symbols import Int64, SymbolCoder
from dfcgs_codec.entropy.symbols import Groups, code_bits, code_with_models
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.companding import compress
from dfcgs_codec.transform.lod import LevelsOfDetail, order_levels
from dfcgs_codec.transform.rotation import from_float

Float32 = npt.NDArray[np.float32]
_BYTE = 256


def ordered_integers(values: Float32) -> Int64:
    """Integers -2**31..2**31 - 1 in the order of the floats; one to one on bits."""
    bits = np.ascontiguousarray(values, "<f4").view("<i4").astype(np.int64)
    return np.where(bits < 0, -(bits & 0x7FFFFFFF) - 1, bits)


def floats(integers: Int64) -> Float32:
    """Inverse of `ordered_integers`."""
    bits = np.where(integers < 0, -(integers + 1) | -0x80000000, integers)
    return bits.astype("<i4").view("<f4").astype(np.float32)


def _code_plane(coder: SymbolCoder, values: Int64 | None, count: int) -> Int64:
    """Bytes with one histogram, or raw where that is as good."""
    known = np.zeros(0, np.int64) if values is None else values

    def is_structured() -> int:
        histogram = np.bincount(known, minlength=_BYTE)
        seen = histogram[histogram > 0]
        entropy = float(seen @ np.log2(count / seen))
        return int(entropy + 6 * _BYTE < 8 * count)

    if not coder.choice(2, is_structured):
        return code_bits(coder, values, 8, count)
    contexts = np.zeros(count, np.uint8)
    models = coder.histograms(np.zeros(1, np.int64), 1, _BYTE, lambda: (known, contexts))
    return code_with_models(coder, values, Groups(contexts, 1), models)


def code_float_column(coder: SymbolCoder, target: Float32 | None, lod: LevelsOfDetail, count: int) -> Float32:
    """One float32 column (N,): the upper half of its bits as a component, the lower as two bytes."""
    integers = None if target is None else ordered_integers(target)
    upper = None if integers is None else integers >> 16
    coded = code_component(coder, upper, lod, EarlierPasses(count)) << 16
    for shift in (8, 0):
        part = None if integers is None else integers >> shift & (_BYTE - 1)
        coded |= _code_plane(coder, part, count) << shift
    return floats(coded)


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
            code_float_column(coder, None if known is None else known[:, c], lod, count) for c in range(width)
        ]
        result.append(np.stack(columns, axis=1))
        if index == 0 and has_permutation:
            given = None if symbols is None else symbols.permutation
            permutation = code_permutation(next_coder(), given, lod, count)
    return VerbatimSymbols(result, permutation)


def cloud_of_columns(columns: list[Float32]) -> GaussianCloud:
    """Inverse of `dpb.verbatim_columns`."""
    n = len(columns[0])
    sh_rest = sh_rest_of_bands(columns[5:], n)
    return GaussianCloud(columns[0], columns[2], columns[1], columns[3][:, 0], columns[4], sh_rest)


def _to_grid(values: Float32, exponent: int) -> Int64:
    # exact up to the one rounding of rint; clipped before the cast, so that it is within range
    scaled = np.rint(np.ldexp(values.astype(np.float64), -exponent))
    return np.clip(scaled, -STATE_LIMIT, STATE_LIMIT).astype(np.int64)


def state_of(cloud: GaussianCloud, units: UnitExponents) -> FrameState:
    """Integer state of float values: the reference that a `ply` I-frame leaves behind (spec section 8)."""
    logits = compress(_to_grid(cloud.opacities, units.opacity), units.opacity)
    planes = {
        Attribute.POSITION: Plane(_to_grid(cloud.positions, units.position)),
        Attribute.SCALE: Plane(_to_grid(cloud.scales, units.scale)),
        Attribute.ROTATION: Plane(from_float(cloud.rotations)),
        Attribute.OPACITY: Plane(logits[:, None]),
        Attribute.SH_DC: Plane(_to_grid(cloud.sh_dc, units.color)),
    }
    for attribute, band in zip(SH_BANDS, sh_bands(cloud.sh_rest), strict=False):
        planes[attribute] = Plane(_to_grid(band, units.color))
    return FrameState(planes, verbatim=cloud)
