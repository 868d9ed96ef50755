"""Coded I-frames against SPZ version 4 at equal errors.

    python -m evaluation.experiments.i_frames.against_spz

Position and scale take SPZ's own steps (both then quantise uniformly, so the errors are equal); the steps of
rotation, opacity, colour and SH are searched: as coarse as keeps RMS and 99.9th percentile at or below
SPZ's. Errors are taken over the values inside SPZ's clamps.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import GaussianCloud
from dfcgs_codec.array_types import Bool, Floats, Int64
from dfcgs_codec.bitstream.constants import STEREO_FRACTION_BITS, Attribute, OutputOrder, Profile
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.codec.state.planes import SH_BANDS, output
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.frame.frame_coding import CodedFrame, coded_intra
from dfcgs_codec.encoder.frame.report import attribute_errors
from dfcgs_codec.encoder.frame.targets import Targets, ordered
from dfcgs_codec.encoder.intra.intra_plan import IntraPlan
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.ply import read_ply
from evaluation.baselines import spz
from lab.assets import find_asset, has_asset
from lab.record import write_result

_SCENES = ("plant_114k_sh0.ply", "playbot_31k_sh2.ply", "playbot_125k_sh2.ply", "sushi_77k_sh3.ply")
_UNITS = UnitExponents(position=-24, scale=-18, opacity=-18, color=-18)
_CONTROL = ControlHeader(70, 0)
_SEQUENCE = SequenceHeader(
    Profile.MAIN, 3, 3, OutputOrder.FREE, (30, 1), FrameNumbers.of([0]), _UNITS, "", bytes(8)
)
Errors = dict[str, Floats]


def _steps(real: dict[Attribute, float]) -> dict[Attribute, int]:
    exponents = {
        Attribute.POSITION: _UNITS.position,
        Attribute.SCALE: _UNITS.scale,
        Attribute.ROTATION: -STEREO_FRACTION_BITS,
        Attribute.OPACITY: _UNITS.opacity,
    }
    return {a: max(1, round(s * 2.0 ** -exponents.get(a, _UNITS.color))) for a, s in real.items()}


class IntraFrame:
    """One splat as an I-frame of the codec: sizes and errors at given steps."""

    def __init__(self, cloud: GaussianCloud) -> None:
        self._planes = Targets(_UNITS).planes(cloud)
        self._names = choose_axis_names(self._planes)
        self._renamed = self._names.rename(self._planes)
        scales = self._names.rename_scales(cloud.scales)
        self._cloud = replace(cloud, scales=scales, rotations=self._names.rename_rotations(cloud.rotations))

    @property
    def axis_order(self) -> Int64:
        """Old axis of each new one, (N, 3)."""
        return self._names.order

    def _coded(self, real: dict[Attribute, float], *, keeps_names: bool) -> tuple[CodedFrame, Int64]:
        """With the same steps for all, and the order of its Gaussians."""
        steps = _steps(real)
        everything = frozenset(steps)
        quantisation = Quantisation(_UNITS, steps, everything, steps, everything)
        plan = IntraPlan.of(self._renamed, None, quantisation)
        order, grid = plan.order(self._renamed[Attribute.POSITION])
        target = plan.target(ordered(self._renamed, order), (order, grid), quantisation, 0.5)
        target = replace(target, keeps_names=keeps_names)
        return coded_intra(FrameWriter(_SEQUENCE, None, 0), target, _CONTROL), order

    def errors(self, real: dict[Attribute, float]) -> tuple[Errors, Int64]:
        """Errors per Gaussian, in the order returned with them."""
        coded, order = self._coded(real, keeps_names=True)
        return attribute_errors(self._cloud.take(order), output(coded.state.frame, _UNITS)), order

    def num_bytes(self, real: dict[Attribute, float]) -> int:
        """Bytes of the frame's chunk, its checksum and hash included."""
        return len(self._coded(real, keeps_names=False)[0].data)


def _inside_clamps(cloud: GaussianCloud) -> dict[str, Bool]:
    """Which values SPZ can hold, shaped like `attribute_errors`."""
    alpha = 1 / (1 + np.exp(-cloud.opacities.astype(np.float64)))
    low, high = spz.LOG_SCALE_RANGE
    dc_low, dc_high = spz.SH_DC_RANGE
    sh_low, sh_high = spz.SH_REST_RANGE
    everything = np.ones(cloud.num_gaussians, bool)
    return {
        "position": everything,
        "rotation": everything,
        "scale": (cloud.scales >= low) & (cloud.scales <= high),
        "alpha": (alpha >= 0.5 * spz.ALPHA_STEP) & (alpha <= 1 - 0.5 * spz.ALPHA_STEP),
        "colour": (cloud.sh_dc >= dc_low) & (cloud.sh_dc <= dc_high),
        "sh": (cloud.sh_rest >= sh_low) & (cloud.sh_rest <= sh_high),
    }


def _summary(errors: Errors, inside: dict[str, Bool]) -> dict[str, dict[str, float]]:
    """RMS and 99.9th percentile by attribute, over the values inside."""
    result = {}
    for name, values in errors.items():
        kept = values[inside[name]].astype(np.float64)
        if kept.size:
            rms, tail = float(np.sqrt((kept * kept).mean())), float(np.quantile(kept, 0.999))
            result[name] = {"rms": rms, "p999": tail}
    return result


def _fits(ours: dict[str, float], theirs: dict[str, float]) -> bool:
    # SPZ's reader and ours round to float32 differently in the last bit
    return all(ours[key] <= theirs[key] * (1 + 1e-4) for key in ("rms", "p999"))


def _coarsest(
    frame: IntraFrame,
    real: dict[Attribute, float],
    names: tuple[tuple[Attribute, ...], str],
    limits: dict[str, Any],
) -> dict[Attribute, float]:
    """`real` with the steps of `names[0]` as coarse as `limits` allows, one step for all."""
    attributes, error_name = names
    inside = limits["inside"]

    def errors_at(step: float) -> dict[str, float]:
        errors, order = frame.errors(real | dict.fromkeys(attributes, step))
        return _summary(errors, {k: v[order] for k, v in inside.items()})[error_name]

    low, high = real[attributes[0]] / 8, real[attributes[0]] * 4
    for _ in range(14):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if _fits(errors_at(middle), limits["spz"][error_name]) else (low, middle)
    return real | dict.fromkeys(attributes, low)


def compare(path: Path, folder: Path) -> dict[str, Any]:
    """SPZ and the codec on one splat."""
    cloud, _ = read_ply(path)
    spz_path = folder / "frame.spz"
    spz.encode_ply(path, spz_path)
    frame, inside = IntraFrame(cloud), _inside_clamps(cloud)
    theirs = _summary(attribute_errors(cloud, spz.decode(spz_path)), inside)
    limits = {"inside": _renamed_inside(inside, frame), "spz": theirs}
    real = {
        Attribute.POSITION: spz.POSITION_STEP,
        Attribute.SCALE: spz.LOG_SCALE_STEP,
        Attribute.ROTATION: 1e-3,
        Attribute.OPACITY: 1 / 64,
        Attribute.SH_DC: spz.SH_DC_STEP,
    } | {a: spz.SH_STEP[i + 1] for i, a in enumerate(SH_BANDS)}
    real = _coarsest(frame, real, ((Attribute.ROTATION,), "rotation"), limits)
    real = _coarsest(frame, real, ((Attribute.OPACITY,), "alpha"), limits)
    real = _coarsest(frame, real, ((Attribute.SH_DC,), "colour"), limits)
    candidates = [real]
    if cloud.sh_degree:
        candidates.append(_coarsest(frame, real, (SH_BANDS, "sh"), limits))
    sizes = [frame.num_bytes(candidate) for candidate in candidates]
    best = candidates[int(np.argmin(sizes))]
    errors, order = frame.errors(best)
    ours = _summary(errors, {k: v[order] for k, v in limits["inside"].items()})
    spz_bytes = spz_path.stat().st_size
    return {
        "num_gaussians": cloud.num_gaussians,
        "sh_degree": cloud.sh_degree,
        "spz_version": spz.version(spz_path),
        "spz_bytes": spz_bytes,
        "codec_bytes": min(sizes),
        "ratio": round(min(sizes) / spz_bytes, 4),
        "errors_fit": {name: _fits(ours[name], theirs[name]) for name in ours},
        "steps": {a.name: s for a, s in best.items()},
        "errors_codec": ours,
        "errors_spz": theirs,
    }


def _renamed_inside(inside: dict[str, Bool], frame: IntraFrame) -> dict[str, Bool]:
    """The masks under the codec's axis names."""
    return inside | {"scale": np.take_along_axis(inside["scale"], frame.axis_order, axis=1)}


def main() -> None:
    """Compare on all scenes that are there and write the result."""
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in filter(has_asset, _SCENES):
            results[name] = compare(find_asset(name), Path(folder))
            print(name, {k: results[name][k] for k in ("spz_bytes", "codec_bytes", "ratio", "errors_fit")})
    conditions = {"spz": spz.REQUIREMENT, "errors": "RMS and 99.9th percentile, inside SPZ's clamps"}
    print(write_result("against_spz", conditions, results))


if __name__ == "__main__":
    main()
