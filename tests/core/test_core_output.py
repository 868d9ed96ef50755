"""Output process and digests of the core (spec sections 8.4, 8.5)."""

from __future__ import annotations

import ctypes
import hashlib

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, STATE_LIMIT, Attribute, Precision
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from tests.core.machines import call

pytestmark = pytest.mark.usefixtures("both_machines")


def _state(rng: np.random.Generator, count: int, degree: int, ordered: bool) -> FrameState:
    attributes = list(Attribute)[: 5 + degree]
    shape = {a: (count, STATE_COLUMNS[a]) for a in attributes}
    planes = {
        a: Plane(rng.integers(-STATE_LIMIT, STATE_LIMIT + 1, s) >> rng.integers(0, 30, s))
        for a, s in shape.items()
    }
    return FrameState(planes, Plane(rng.permutation(count)[:, None]) if ordered else None)


@pytest.mark.parametrize("exponents", [(-60, -60, -60, -60), (60, 60, -11, 60), (-12, -9, -13, -10)])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("ordered", [False, True])
def test_output(degree: int, ordered: bool, exponents: tuple[int, int, int, int]) -> None:
    rng, count = np.random.default_rng(degree), 300
    state = _state(rng, count, degree, ordered)
    planes = {a: plane.values for a, plane in state.planes.items()}
    order = None if state.order is None else np.array(state.order.values[:, 0])
    origins = ((0, 0, 0), (1 << 52, -(1 << 52), 12_345_678_901))
    for origin in origins:
        for precision in Precision:
            wanted = output(state, UnitExponents(*exponents, origin, precision))
            width = "double" if precision == Precision.FLOAT64 else "float"
            positions = np.zeros_like(wanted.positions)
            start = np.array(origin, np.int64)
            arguments = planes[Attribute.POSITION], count, start, exponents[0], order, positions
            call(f"{width}_positions", *arguments)
            assert positions.tobytes() == wanted.positions.tobytes()
    for attribute, values, exponent in (
        (Attribute.SCALE, wanted.scales, exponents[1]),
        (Attribute.ROTATION, wanted.rotations, -24),
        (Attribute.SH_DC, wanted.sh_dc, exponents[3]),
    ):
        found = np.zeros_like(values)
        call("floats", planes[attribute], count, values.shape[1], exponent, order, found)
        assert found.tobytes() == values.tobytes()
    logits, bands = np.zeros_like(wanted.opacities), np.zeros_like(wanted.sh_rest)
    call("float_logits", planes[Attribute.OPACITY], count, exponents[2], order, logits)
    assert logits.tobytes() == wanted.opacities.tobytes()
    known = [planes.get(a) for a in (Attribute.SH_1, Attribute.SH_2, Attribute.SH_3)]
    call("float_bands", *known, count, exponents[3], order, bands)
    assert bands.tobytes() == wanted.sh_rest.tobytes()


@pytest.mark.parametrize("count", [0, 1, 127, 128, 129, 255, 256, 257, 1000, 100_003])
def test_digests(count: int) -> None:
    data = np.random.default_rng(count).integers(0, 256, count).astype(np.uint8)
    digest = np.zeros(16, np.uint8)
    call("digest", data, count, digest)
    assert digest.tobytes() == hashlib.blake2b(data.tobytes(), digest_size=16).digest()


def test_digests_of_parts() -> None:
    rng, state = np.random.default_rng(0), np.zeros(256, np.uint8)
    for _ in range(60):
        parts = [
            rng.integers(0, 256, rng.integers(0, 400)).astype(np.uint8) for _ in range(rng.integers(0, 9))
        ]
        digest = np.zeros(16, np.uint8)
        call("hash_start", state)
        for part in parts:
            _add(state, part)
        call("hash_end", state, digest)
        assert digest.tobytes() == hashlib.blake2b(b"".join(map(bytes, parts)), digest_size=16).digest()


def _add(state: np.ndarray, part: np.ndarray) -> None:
    call("hash_add", state, part, ctypes.c_size_t(len(part)))
