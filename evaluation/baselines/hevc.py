"""Attributes as images in Morton order through an HEVC encoder, in the manner of GSCodec and V-PCC.

Gaussians keep the Morton order of the first frame, so that N must be constant and the index be the
identity. Every attribute is a video: its grid values in LEVELS per codec step (`plan_quantisation` at the
setting's QP, opacity companded), 12 bits. HEVC then quantises with a step of its own, at HEVC_QP exactly that
of the codec; I-frames are finer and B-frames coarser by the encoder's default ratios. What 12 bits do not
hold goes to a second, lossless video (see `attribute_maps`).

Rotations are four quaternion components of continuous sign. x265 preset medium, an I-frame every 60 frames.

It cannot follow a change of N, nor of the order; errors have no bound, only a size.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import STATE_LIMIT, STEREO_FRACTION_BITS, Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import FrameState, Plane, output
from dfcgs_codec.encoder.frame.targets import Targets, ordered
from dfcgs_codec.encoder.residual.quantise import order_of, plan_grid
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.transform.rotation import ONE, normalise, round_divide
from evaluation.baselines import x265
from evaluation.baselines.attribute_maps import BITS, Layout, fold, unfold
from evaluation.baselines.frames import planned, planned_version, read_frames, write_frames
from evaluation.baselines.method import Method, MethodRefused, SequenceFacts

_WRAPPER = 1
_HEADER = "sequence.json"
#: levels per step; at HEVC_QP the step of 12-bit HEVC is 16 levels, 2**((QP - 4) / 6) levels of 8 bits
LEVELS, HEVC_QP = 16, 4
#: quaternion component per stereographic unit: equal largest angle
_ROTATION_STEP = 3**0.5
Planes = dict[Attribute, Int64]


def _units(steps: dict[Attribute, int]) -> dict[Attribute, float]:
    """Grid units per level."""
    units = {attribute: step / LEVELS for attribute, step in steps.items()}
    units[Attribute.ROTATION] *= _ROTATION_STEP * ONE / 2.0**STEREO_FRACTION_BITS
    return units


def _planes(frames: Path, targets: Targets, step: int) -> Iterator[Planes]:
    """Grid planes in the order of the first frame, quaternions of continuous sign, first with w >= 0."""
    order, before = None, np.array([[1, 0, 0, 0]])
    for cloud in read_frames(frames):
        planes = targets.planes(cloud)
        if order is None:
            indices = round_divide(planes[Attribute.POSITION], step)
            order = order_of(indices, plan_grid(indices))
        planes = ordered(planes, order)
        rotations = planes[Attribute.ROTATION]
        before = np.where(((rotations * before).sum(axis=1) < 0)[:, None], -rotations, rotations)
        planes |= {Attribute.ROTATION: before}
        # all frames are in memory at once
        yield {attribute: values.astype(np.int32) for attribute, values in planes.items()}


def _write_videos(target: Path, attribute: Attribute, levels: list[Int64]) -> None:
    layout = Layout(*levels[0].shape)
    parts = [fold(values) for values in levels]
    if max(int(high.max()) for _, high in parts) >= 1 << BITS:
        raise MethodRefused(f"{attribute.name.lower()} has a range of more than {2 * BITS} bits of levels")
    name = attribute.name.lower()
    low = (layout.image(low) for low, _ in parts)
    x265.encode(target / f"{name}.hevc", low, layout.shape, f"qp={HEVC_QP}")
    if any(high.any() for _, high in parts):
        images = (layout.image(high) for _, high in parts)
        x265.encode(target / f"{name}_high.hevc", images, layout.shape, "lossless=1")


def _encode(frames: Path, target: Path, setting: str) -> None:
    plan = planned(float(setting.removeprefix("qp")), next(read_frames(frames)))
    try:
        sequence = list(_planes(frames, Targets(plan.units), plan.steps[Attribute.POSITION]))
    except InputError as error:
        raise MethodRefused(str(error)) from error
    units, attributes = _units(plan.steps), {}
    for attribute in sequence[0]:
        levels = [np.rint(planes[attribute] / units[attribute]).astype(np.int32) for planes in sequence]
        lowest = min(int(values.min()) for values in levels)
        _write_videos(target, attribute, [values - lowest for values in levels])
        attributes[attribute.name] = [units[attribute], lowest, levels[0].shape[1]]
    exponents = [plan.units.position, plan.units.scale, plan.units.opacity, plan.units.color]
    header = {"n": len(sequence[0][Attribute.POSITION]), "exponents": exponents, "attributes": attributes}
    (target / _HEADER).write_text(json.dumps(header, separators=(",", ":")))


def _levels(target: Path, name: str, layout: Layout) -> Iterator[Int64]:
    """Levels (N, C) of an attribute, frame by frame."""
    low, high = target / f"{name}.hevc", target / f"{name}_high.hevc"
    lows = (layout.values(image) for image in x265.decode(low, layout.shape))
    if not high.exists():
        return lows
    highs = (layout.values(image) for image in x265.decode(high, layout.shape))
    return (unfold(*parts) for parts in zip(lows, highs, strict=True))


def _grid_values(levels: Iterator[Int64], unit: float, lowest: int) -> Iterator[Int64]:
    for values in levels:
        grid = np.rint((values + lowest) * unit).astype(np.int64)
        yield np.clip(grid, -STATE_LIMIT, STATE_LIMIT)


def _clouds(target: Path) -> Iterator[GaussianCloud]:
    header = json.loads((target / _HEADER).read_text())
    units, streams = UnitExponents(*header["exponents"]), {}
    for name, (unit, lowest, columns) in header["attributes"].items():
        levels = _levels(target, name.lower(), Layout(header["n"], columns))
        streams[Attribute[name]] = _grid_values(levels, unit, lowest)
    for frame in zip(*streams.values(), strict=True):
        planes = dict(zip(streams, frame, strict=True))
        planes[Attribute.ROTATION] = normalise(planes[Attribute.ROTATION])
        yield output(FrameState({a: Plane(v) for a, v in planes.items()}), units)


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds(target))


def _version() -> str:
    return f"{x265.version()} {planned_version()} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    return None if facts.constant_count else "maps need the same N in all frames"


_SETTINGS = ("qp16", "qp22", "qp28", "qp34")
METHOD = Method("hevc", "HEVC attribute maps", _SETTINGS, _version, _accepts, _encode, _decode)
