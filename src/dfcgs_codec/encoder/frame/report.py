"""What an encode did: bytes per frame, and the errors that were measured."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from dfcgs_codec.array_types import Float64, Floats
from dfcgs_codec.encoder.plan.quantiser_steps import SH_C0, Bound
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud


@dataclass
class ErrorStatistics:
    """Largest and mean absolute error of one attribute, in the unit of `quantiser_steps.BOUND_UNITS`."""

    maximum: float = 0.0
    total: float = 0.0
    count: int = 0

    @property
    def mean(self) -> float:
        """Mean over all Gaussians and frames."""
        return self.total / self.count if self.count else 0.0

    def add(self, errors: Floats) -> None:
        """Take in the absolute errors of a frame."""
        if errors.size:
            self.maximum = max(self.maximum, float(errors.max()))
            self.total += float(errors.sum(dtype=np.float64))
            self.count += errors.size

    def merge(self, other: ErrorStatistics) -> None:
        """Take in another part of the sequence."""
        self.maximum = max(self.maximum, other.maximum)
        self.total += other.total
        self.count += other.count


def _rotation_error(a: Floats, b: Floats) -> Float64:
    """Angle in degrees between quaternions (N, 4), from the chord, which small angles need."""
    u, v = a.astype(np.float64), b.astype(np.float64)
    u /= np.sqrt((u * u).sum(axis=1, keepdims=True))
    v /= np.sqrt((v * v).sum(axis=1, keepdims=True))
    chord = np.minimum(((u - v) ** 2).sum(axis=1), ((u + v) ** 2).sum(axis=1))
    degrees: Float64 = np.degrees(4 * np.arcsin(np.minimum(np.sqrt(chord) / 2, 1)))
    return degrees


def _alpha(logit: Floats) -> Float64:
    alpha: Float64 = 1 / (1 + np.exp(-np.clip(logit.astype(np.float64), -60, 60)))
    return alpha


#: array of a GaussianCloud that each error is measured on
ERROR_FIELDS = {
    "position": "positions",
    "rotation": "rotations",
    "scale": "scales",
    "alpha": "opacities",
    "colour": "sh_dc",
    "sh": "sh_rest",
}


def _all_finite(values: Floats) -> bool:
    return bool(not values.size or (np.isfinite(values.min()) and np.isfinite(values.max())))


def errors_of(name: str, source: Floats, decoded: Floats) -> Floats:
    """Absolute errors of `ERROR_FIELDS[name]`: per Gaussian (position, rotation, alpha) or component.

    Values that are not finite have no error where they are kept as they are, else an infinite one.
    """
    if name != "rotation" and _all_finite(source) and _all_finite(decoded):
        return _errors_of(name, source, decoded)
    odd = ~np.isfinite(source) | ~np.isfinite(decoded)
    if name == "rotation":
        odd |= np.broadcast_to((source == 0).all(axis=1, keepdims=True), odd.shape)
        odd = np.broadcast_to(odd.any(axis=1, keepdims=True), odd.shape)
    if not odd.any():
        return _errors_of(name, source, decoded)
    lost = odd & (source != decoded) & ~(np.isnan(source) & np.isnan(decoded))
    errors = _errors_of(name, np.where(odd, 1, source), np.where(odd, 1, decoded))
    if errors.ndim < lost.ndim:
        lost = lost.any(axis=1)
    return np.where(lost, np.inf, errors)


def _errors_of(name: str, source: Floats, decoded: Floats) -> Floats:
    if name == "position":
        distance = source.astype(np.float64) - decoded
        errors: Floats = np.sqrt((distance * distance).sum(axis=1))
        return errors
    if name == "rotation":
        return _rotation_error(source, decoded)
    if name == "alpha":
        return np.abs(_alpha(source) - _alpha(decoded))
    difference: Floats = np.abs(source - decoded)
    return difference * difference.dtype.type(SH_C0) if name == "colour" else difference


def attribute_errors(source: GaussianCloud, decoded: GaussianCloud) -> dict[str, Floats]:
    """The errors of all attributes."""
    return {
        name: errors_of(name, getattr(source, field), getattr(decoded, field))
        for name, field in ERROR_FIELDS.items()
    }


@dataclass(frozen=True)
class FrameRecord:
    """One coded frame: its number, kind (I, P or skip), Gaussians, and bytes of its chunks."""

    number: int
    kind: str
    num_gaussians: int
    num_bytes: int


@dataclass
class EncodeReport:
    """Frames, file size, measured errors, and notes about the input.

    `held_frames`: P-frames whose profile kept what changed in the input besides position and rotation;
    `num_escapes`: values that the grids do not hold, in `escaped_frames`; `qp` that was chosen, None of
    lossless files; `estimated_psnr` of images, dB, None where nothing can be said; `num_unseen`: Gaussians of
    the first frame that show from none of the cameras and are left out, None without cameras, and
    `unseen_cost_db`: what that costs of the PSNR of images, dB; `behind`: by how many dB each frame seems
    worse than an I-frame there.
    """

    frames: list[FrameRecord] = field(default_factory=list)
    errors: dict[str, ErrorStatistics] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    num_bytes: int = 0
    held_frames: int = 0
    num_escapes: int = 0
    escaped_frames: int = 0
    qp: float | None = None
    estimated_psnr: float | None = None
    num_unseen: int | None = None
    unseen_cost_db: float | None = None
    behind: list[float] = field(default_factory=list)

    def add_frame(self, record: FrameRecord, errors: dict[str, ErrorStatistics]) -> None:
        """Record a frame and its errors."""
        self.frames.append(record)
        for name, statistics in errors.items():
            self.errors.setdefault(name, ErrorStatistics()).merge(statistics)

    def merge(self, other: EncodeReport) -> None:
        """Append the report of the following frames."""
        self.frames += other.frames
        self.notes += other.notes
        self.held_frames += other.held_frames
        self.num_escapes += other.num_escapes
        self.escaped_frames += other.escaped_frames
        self.behind += other.behind
        for name, statistics in other.errors.items():
            self.errors.setdefault(name, ErrorStatistics()).merge(statistics)

    def check_bounds(self, bounds: Iterable[Bound]) -> None:
        """InputError when a guaranteed bound could not be kept."""
        for bound in bounds:
            found = self.errors[bound.attribute].maximum
            if found > bound.value:
                raise InputError(
                    f"--bound {bound.attribute}={bound.value:g} cannot be kept: {found:g} was measured. It "
                    "is near the spacing of float32 numbers or of the grid at the scene's far end; loosen it"
                )
