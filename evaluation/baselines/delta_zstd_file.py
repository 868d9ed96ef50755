"""Baseline "quantised delta + zstd" as a codec: what one builds in an afternoon, built well.

One file. I-frames begin every GoF: Gaussians in Morton order, per attribute either bins or differences of
bins along the order. P-frames: differences of bins from the previous frame, in the order of the GoF. Where N
changes, an R-frame: as an I-frame in an order of its own, but zstd looks for repetitions in the frame before,
as the Gaussians that stand still follow one another as before. The same is tried where a P-frame is no
smaller than the I-frame before it (a scene cut). Each attribute is zigzag byte planes in one frame of zstd.

Decoded Gaussians come in Morton order, not in that of the input.

    file       "QDZ1", u32 frames, u8 SH degree, i8 exponents (position, scale, opacity, colour), u32 step of
               each attribute
    frame      u8 kind (0 I, 1 P, 2 R); but of a P-frame u32 N; the attributes
    attribute  see `delta_streams`
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dfcgs_codec.bitstream.constants import STATE_COLUMNS, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import SH_BANDS, output
from dfcgs_codec.encoder.frame.targets import Targets, ordered
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.residual.quantise import order_of, plan_grid
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.rotation import round_divide
from evaluation.baselines.delta_streams import REQUIREMENT, Reader, attribute_bytes
from evaluation.baselines.delta_symbols import Coded, Planes, differences, sums, symbols_of
from evaluation.baselines.frames import pinned, planned, planned_version, read_frames, write_frames
from evaluation.baselines.method import Method, MethodRefused, SequenceFacts

_WRAPPER = 1
_MAGIC = b"QDZ1"
_FILE = "sequence.qdz"
_HEADER = struct.Struct("<4sIB4b8I")
_INTRA, _INTER, _REPEATING = 0, 1, 2


def _attributes(sh_degree: int) -> list[Attribute]:
    return [a for a in STATE_COLUMNS if a not in SH_BANDS[sh_degree:]]


class _Encoder:
    """Frames to bytes; remembers the frame before and the order of the GoF."""

    def __init__(self, quantisation: Quantisation, gof_size: int) -> None:
        self._steps = quantisation.steps
        self._targets = Targets(quantisation.units)
        self._gof_size = gof_size
        self._since_intra = gof_size
        self._intra_bytes = 0
        self._order = np.zeros(0, np.int64)
        self._before: Coded | None = None

    def frame(self, cloud: GaussianCloud) -> bytes:
        planes = self._targets.planes(cloud)
        if self._since_intra >= self._gof_size:
            data, coded = self._own_order(planes, None)
            self._since_intra, self._intra_bytes = 0, len(data)
            return self._accept(data, coded)
        if cloud.num_gaussians != len(self._order):
            return self._accept(*self._own_order(planes, self._before))
        inter, coded = self._inter(planes)
        if len(inter) >= self._intra_bytes:
            return self._smaller(planes, inter, coded)
        return self._accept(inter, coded)

    def _own_order(self, planes: Planes, before: Coded | None) -> tuple[bytes, Coded]:
        """An I-frame, or with a frame before to look for repetitions an R-frame; sets the order."""
        step = self._steps[Attribute.POSITION]
        indices = round_divide(planes[Attribute.POSITION], step)
        self._order = order_of(indices, plan_grid(indices))
        symbols = symbols_of(ordered(planes, self._order), self._steps, None)
        parts = [struct.pack("<BI", _INTRA if before is None else _REPEATING, len(self._order))]
        for a in sorted(symbols):
            known = None if before is None else before.symbols[a]
            parts.append(attribute_bytes(symbols[a], try_along=True, before=known))
        return b"".join(parts), Coded.of(symbols, self._steps)

    def _inter(self, planes: Planes) -> tuple[bytes, Coded]:
        assert self._before is not None
        symbols = symbols_of(ordered(planes, self._order), self._steps, self._before)
        residuals = differences(symbols, self._before, self._steps)
        parts = [attribute_bytes(residuals[a]) for a in sorted(residuals)]
        return bytes([_INTER]) + b"".join(parts), Coded.of(symbols, self._steps)

    def _smaller(self, planes: Planes, inter: bytes, coded: Coded) -> bytes:
        """An R-frame if that is smaller than `inter`."""
        order = self._order
        data, other = self._own_order(planes, self._before)
        if len(data) <= len(inter):
            return self._accept(data, other)
        self._order = order
        return self._accept(inter, coded)

    def _accept(self, data: bytes, coded: Coded) -> bytes:
        self._before = coded
        self._since_intra += 1
        return data


def _setting(setting: str) -> tuple[float, int]:
    """QP and GoF size of "qp22_gof10"."""
    qp, gof = setting.split("_")
    return float(qp.removeprefix("qp")), int(gof.removeprefix("gof"))


def _encode(frames: Path, target: Path, setting: str) -> None:
    pinned(REQUIREMENT)
    qp, gof_size = _setting(setting)
    first = next(read_frames(frames))
    quantisation = planned(qp, first)
    units = quantisation.units
    exponents = (units.position, units.scale, units.opacity, units.color)
    encoder = _Encoder(quantisation, gof_size)
    try:
        coded = [encoder.frame(cloud) for cloud in read_frames(frames)]
    except InputError as error:
        raise MethodRefused(str(error)) from error
    steps = [quantisation.steps[a] for a in STATE_COLUMNS]
    header = _HEADER.pack(_MAGIC, len(coded), first.sh_degree, *exponents, *steps)
    (target / _FILE).write_bytes(header + b"".join(coded))


def _decoded(data: bytes) -> Iterator[GaussianCloud]:
    reader = Reader(data)
    _, num_frames, sh_degree, *numbers = reader.fields(_HEADER)
    position, scale, opacity, color = numbers[:4]
    units = UnitExponents(position=position, scale=scale, opacity=opacity, color=color)
    steps = dict(zip(STATE_COLUMNS, numbers[4:], strict=True))
    before, count = None, 0
    for _ in range(num_frames):
        (kind,) = reader.fields(struct.Struct("<B"))
        if kind != _INTER:
            (count,) = reader.fields(struct.Struct("<I"))
        known = before.symbols if before is not None and kind == _REPEATING else {}
        symbols = {a: reader.attribute(count, STATE_COLUMNS[a], known.get(a)) for a in _attributes(sh_degree)}
        if kind == _INTER:
            assert before is not None
            symbols = sums(symbols, before, steps)
        before = Coded.of(symbols, steps)
        yield output(before.state(steps), units)


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _decoded((target / _FILE).read_bytes()))


def _version() -> str:
    return f"{pinned(REQUIREMENT)} {planned_version()} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    del facts
    return None


_SWEEP = {10: (16, 22, 28, 34), 60: (16, 25, 34)}
_SETTINGS = tuple(f"qp{qp}_gof{gof}" for gof, qps in _SWEEP.items() for qp in qps)
METHOD = Method("delta_zstd", "quantised delta + zstd", _SETTINGS, _version, _accepts, _encode, _decode)
