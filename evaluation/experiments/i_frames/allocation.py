"""Are the reference steps in the right proportion? `python -m evaluation.experiments.i_frames.allocation`.

For the first frame of every scene (at most 20 000 Gaussians): the error that each attribute's step causes in
the rendered image, the bits that the codec spends on it at that step, and the steps that give a total error
for the fewest bits. `excess` is what the codec's own proportions cost above that. Those of
`encoder.plan.quantiser_steps` were chosen from the training scenes; the evaluation scenes show what that
costs there. All with uniform steps: steps that follow visibility, and balanced ones, begin from these.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, encode_sequence, probe
from dfcgs_codec.array_types import Float64
from dfcgs_codec.encoder.plan.quantiser_steps import (
    FINE_POSITION_QP_PER_OCTAVE,
    QP_PER_OCTAVE,
    REFERENCE_QP,
    REFERENCE_STEPS,
    REFERENCE_VALUES,
)
from evaluation.experiments.i_frames.sensitivity import attributes_of, error_curves
from lab.assets import find_asset, present
from lab.record import write_result
from lab.scenes.catalogue import Scene, group

OCTAVES = tuple(range(-6, 5))
TARGETS = (-34.0, -38.0, -42.0, -46.0, -50.0)
_MOST_GAUSSIANS = 20_000
_GRID = np.linspace(OCTAVES[0], OCTAVES[-1], 401)
_SMALLEST_ERROR = 1e-13
_UNIFORM = EncoderOptions(qp=REFERENCE_QP, tuning=EncoderTuning(visibility=False, exact=False))


def _at(octave: float, cloud: GaussianCloud) -> EncoderOptions:
    """All steps, positions too, at `octave` from the reference steps, whatever the SH degree."""
    # the encoder makes steps finer where a Gaussian has more values
    values = 13 + 3 * cloud.sh_rest.shape[2]
    scale = 2.0**octave * math.sqrt(values / REFERENCE_VALUES)
    return _UNIFORM.tuned(reference_steps={a: s * scale for a, s in REFERENCE_STEPS.items()})


def rate_curves(cloud: GaussianCloud) -> dict[str, list[float]]:
    """Bits per Gaussian of an I-frame by attribute, at each octave."""
    curves: dict[str, list[float]] = {a.name: [] for a in attributes_of(cloud)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.dgs"
        for octave in OCTAVES:
            encode_sequence([cloud], path, _at(octave, cloud), force=True)
            spent = probe(path).frames[0].attribute_bytes
            for name, curve in curves.items():
                curve.append(8.0 * spent.get(name, 0) / cloud.num_gaussians)
    return curves


def _fine(curve: list[float], *, logarithmic: bool) -> Float64:
    """A curve over OCTAVES on the grid of steps; errors are made to grow with the step."""
    values = np.array(curve)
    if logarithmic:
        values = np.log(np.maximum(np.maximum.accumulate(values), _SMALLEST_ERROR))
    fine = PchipInterpolator(OCTAVES, values)(_GRID)
    return np.exp(fine) if logarithmic else fine


def _decibel(value: float) -> float:
    return 10.0 * float(np.log10(value))


def best_steps(errors: dict[str, Float64], rates: dict[str, Float64], target: float) -> dict[str, int]:
    """Grid index of each attribute's step for the fewest bits at a total error of `target` decibel."""
    low, high = -40.0, 0.0
    chosen: dict[str, int] = {}
    for _ in range(60):
        weight = np.exp((low + high) / 2)
        chosen = {a: int(np.argmin(errors[a] + weight * rates[a])) for a in errors}
        too_much = _decibel(sum(float(errors[a][i]) for a, i in chosen.items())) > target
        low, high = (low, (low + high) / 2) if too_much else ((low + high) / 2, high)
    return chosen


def codec_steps(names: list[str], octave: float) -> dict[str, int]:
    """Grid index of each attribute's step when the codec's QP moves by `octave` octaves."""
    fine = QP_PER_OCTAVE / FINE_POSITION_QP_PER_OCTAVE if octave < 0 else 1.0
    moved = {a: octave * (fine if a == "POSITION" else 1.0) for a in names}
    return {a: int(np.argmin(np.abs(_GRID - o))) for a, o in moved.items()}


def compare(
    errors: dict[str, list[float]], rates: dict[str, list[float]], targets: tuple[float, ...] = TARGETS
) -> dict[str, Any]:
    """Best steps and the codec's at each total error, decibel."""
    fine_errors = {a: _fine(c, logarithmic=True) for a, c in errors.items()}
    fine_rates = {a: _fine(c, logarithmic=False) for a, c in rates.items()}

    def total(curves: dict[str, Float64], steps: dict[str, int]) -> float:
        return sum(float(curves[a][i]) for a, i in steps.items())

    results = {}
    for target in targets:
        best = best_steps(fine_errors, fine_rates, target)
        reached = total(fine_errors, best)
        shifts = np.linspace(-4.0, OCTAVES[-1], 321)
        candidates = [codec_steps(list(errors), float(s)) for s in shifts]
        ours = min(candidates, key=lambda s: abs(np.log(total(fine_errors, s) / reached)))
        bits, codec_bits = total(fine_rates, best), total(fine_rates, ours)
        results[str(target)] = {
            "best_octaves": {a: round(float(_GRID[i]), 2) for a, i in best.items()},
            "codec_octaves": {a: round(float(_GRID[i]), 2) for a, i in ours.items()},
            "best_bits": round(bits, 2),
            "codec_bits": round(codec_bits, 2),
            "excess": round(codec_bits / bits - 1.0, 4),
        }
    return results


def _measure(scene: Scene) -> dict[str, Any]:
    cloud = next(iter(scene.frames(find_asset(scene.asset))))
    if cloud.num_gaussians > _MOST_GAUSSIANS:
        rng = np.random.default_rng(0)
        cloud = cloud.take(np.sort(rng.choice(cloud.num_gaussians, _MOST_GAUSSIANS, replace=False)))
    errors, rates = error_curves(cloud, scene.up, OCTAVES), rate_curves(cloud)
    return {
        "group": scene.group,
        "mse": errors,
        "bits_per_gaussian": rates,
        "targets": compare(errors, rates),
    }


def main() -> None:
    """Measure all scenes that are there and write the result."""
    results: dict[str, Any] = {}
    for scene in present([*group("training"), *group("evaluation")]):
        results[scene.name] = measured = _measure(scene)
        excess = {t: f"{100 * r['excess']:.1f} %" for t, r in measured["targets"].items()}
        print(scene.name, excess, measured["targets"]["-42.0"]["best_octaves"], flush=True)
    steps = {a.name: s for a, s in REFERENCE_STEPS.items()}
    print(write_result("allocation", {"reference_steps": steps, "octaves": OCTAVES}, results))


if __name__ == "__main__":
    main()
