"""Section 8.4: the output process."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import COLUMNS, OPACITY, POSITION, ROTATION, SCALE, SH_DC, Fields
from tests.spec_decoder.headers import read_escapes
from tests.spec_decoder.state import expand
from tests.spec_decoder.verbatim import float_of

if TYPE_CHECKING:
    from tests.spec_decoder.headers import Sequence
    from tests.spec_decoder.state import State


@dataclass
class Frame:
    index: int
    frame_hash: bytes
    state: State
    sequence: Sequence

    def output(self) -> dict[str, list[float]]:
        """8.4: float32 values of each PLY property, in output order."""
        return output(self.state, self.sequence)


def to_float32(value: int, exponent: int) -> float:
    rounded: float = struct.unpack("<f", struct.pack("<f", math.ldexp(value, exponent)))[0]
    return rounded


def float_planes(state: State, sequence: Sequence) -> dict[int, list[list[float]]]:
    if state.verbatim is not None:
        return {a: [[float_of(p) for p in row] for row in rows] for a, rows in state.verbatim.items()}
    planes = {}
    for attribute, rows in state.planes.items():
        e = sequence.exponents[min(attribute, SH_DC)]
        if attribute == OPACITY:
            rows = [[expand(row[0], e)] for row in rows]
        if attribute == POSITION:
            places = [[value + o for value, o in zip(row, sequence.origin, strict=True)] for row in rows]
            convert = math.ldexp if sequence.is_double else to_float32
            planes[attribute] = [[convert(value, e) for value in row] for row in places]
            continue
        planes[attribute] = [[to_float32(value, e) for value in row] for row in rows]
    return planes


def escaped(state: State, sequence: Sequence) -> dict[int, list[list[float]]]:
    """With the exact values of escapes in their places."""
    planes = float_planes(state, sequence)
    if state.escapes:
        for row, column, value in read_escapes(Fields(state.escapes), sequence):
            for attribute in sorted(planes):
                if column < COLUMNS[attribute]:
                    planes[attribute][row][column] = value
                    break
                column -= COLUMNS[attribute]
    return planes


def output(state: State, sequence: Sequence) -> dict[str, list[float]]:
    planes = escaped(state, sequence)
    names = {
        POSITION: ["x", "y", "z"],
        SCALE: ["scale_0", "scale_1", "scale_2"],
        ROTATION: ["rot_0", "rot_1", "rot_2", "rot_3"],
        OPACITY: ["opacity"],
        SH_DC: ["f_dc_0", "f_dc_1", "f_dc_2"],
    }
    columns = {
        name: [row[c] for row in planes[attribute]]
        for attribute, group in names.items()
        for c, name in enumerate(group)
    }
    coefficients = (0, 3, 8, 15)
    total = coefficients[sequence.sh_degree]
    for channel in range(3):
        for m in range(total):
            band = 1 if m < 3 else 2 if m < 8 else 3
            k = m - coefficients[band - 1]
            columns[f"f_rest_{channel * total + m}"] = [row[3 * k + channel] for row in planes[SH_DC + band]]
    if state.order is None:
        return columns
    places = state.order
    return {
        name: [v for _, v in sorted(zip(places, values, strict=True))] for name, values in columns.items()
    }
