"""The codec against "quantised delta + zstd" at equal steps: `python -m evaluation.experiments.against_zstd`.

Whole files of the codec (every byte on disk) against the sum of the baseline's zstd frames, which have no
container, no checksums and no hashes. Largest errors are equal by construction, and measured.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import Attribute, OutputOrder
from dfcgs_codec.codec.frame.decoder import DecodedFrame
from dfcgs_codec.encoder.frame.targets import Targets, ordered
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.encoder.residual.quantise import (
    Planes,
    ResidualQuantiser,
    ZeroBin,
    inter_symbols,
    order_of,
    plan_grid,
)
from dfcgs_codec.ply import read_ply
from dfcgs_codec.sequence import MemorySource
from dfcgs_codec.transform.rotation import round_divide
from evaluation.baselines.delta_zstd import DeltaZstd
from lab.assets import find_asset
from lab.record import write_result
from lab.scenes import VARIANTS, SceneOptions, animated_sequence, trained_sequence

_GOF_SIZE = 10
#: with the same errors as the baseline
_OPTIONS = EncoderOptions(
    qp=28, order=OutputOrder.FREE, gof_size=_GOF_SIZE, tuning=EncoderTuning(zero_bin=0.5, visibility=False)
)


_FRAMES = 20


def _tracked_splat() -> list[GaussianCloud]:
    """A trained splat: a part turns, the rest changes as 3DGStream's output does."""
    cloud, _ = read_ply(find_asset("playbot_125k_sh2.ply", "playbot_31k_sh2.ply"))
    clean = trained_sequence(cloud, SceneOptions(_FRAMES), "part")
    return list(VARIANTS["noisy"](clean, 0))


def _animated_character() -> list[GaussianCloud]:
    """50 000 Gaussians on a walking character; positions and rotations move, the rest is constant."""
    return list(animated_sequence(find_asset("Knight.glb"), SceneOptions(_FRAMES, 50_000, 1), "Walking_A"))


def _all_change() -> list[GaussianCloud]:
    """A trained splat that sways while every attribute of every Gaussian drifts."""
    cloud, _ = read_ply(find_asset("playbot_31k_sh2.ply"))
    clean = trained_sequence(cloud, SceneOptions(_FRAMES), "sway")
    return list(VARIANTS["drift"](clean, 0))


SCENES: dict[str, Callable[[], list[GaussianCloud]]] = {
    "tracked_splat": _tracked_splat,
    "animated_character": _animated_character,
    "all_attributes_change": _all_change,
}


def _targets(source: MemorySource, plan: SequencePlan) -> list[Planes]:
    """Each frame's planes in the order and under the axis names of its GoF, as the encoder sees them."""
    targets = Targets(plan.header.unit_exponents)
    result = []
    for index, cloud in enumerate(source.frames):
        planes = targets.planes(cloud)
        if index % _GOF_SIZE == 0:
            step = plan.quantisation.steps[Attribute.POSITION]
            indices = round_divide(planes[Attribute.POSITION], step)
            order = order_of(indices, plan_grid(indices))
        if index == 0:
            names = choose_axis_names(planes)
        result.append(ordered(names.rename(planes), order))
    return result


def baseline_sizes(
    source: MemorySource, plan: SequencePlan, decoded: list[DecodedFrame]
) -> list[dict[str, int]]:
    """Bytes of the baseline by frame and attribute; `decoded` gives the closed loop of the turns."""
    targets = _targets(source, plan)
    quantiser = ResidualQuantiser(plan.quantisation, ZeroBin(0.5))
    baseline = DeltaZstd(plan.quantisation.steps)
    sizes = []
    for index, planes in enumerate(targets):
        if index % _GOF_SIZE == 0:
            sizes.append(baseline.intra(planes))
            continue
        reference = decoded[index - 1].state
        symbols = inter_symbols(planes, targets[index - 1], (reference, reference), quantiser)
        turn = symbols.activity.get(Attribute.ROTATION)
        sizes.append(baseline.inter(planes, None if turn is None else turn.symbols))
    return sizes


def _total(sizes: list[dict[str, int]], rotation: str) -> int:
    other = "TURN" if rotation == "ROTATION" else "ROTATION"
    return sum(sum(v for k, v in frame.items() if k != other) for frame in sizes)


def _forms(sizes: list[dict[str, int]]) -> list[tuple[str, list[dict[str, int]]]]:
    """Frame sizes under both forms of the baseline's rotations; I-frames have one form."""
    turned = [{"TURN" if k == "ROTATION" and "TURN" not in f else k: v for k, v in f.items()} for f in sizes]
    return [("ROTATION", sizes), ("TURN", turned)]


def compare(name: str, source: MemorySource, folder: Path) -> dict[str, Any]:
    """Bytes and ratios of one scene."""
    path = folder / f"{name}.dgs"
    report = encode_sequence(source, path, _OPTIONS, force=True)
    info = probe(path)
    plan = plan_sequence(source, _OPTIONS)
    sizes = baseline_sizes(source, plan, list(decode_sequence(path)))
    ours_p = sum(f.num_bytes for f in info.frames if f.frame_type != "I")
    by_attribute: Counter[str] = Counter()
    for frame in info.frames:
        if frame.frame_type != "I":
            by_attribute.update(frame.attribute_bytes)
    result: dict[str, Any] = {
        "num_gaussians": info.frames[0].num_gaussians,
        "num_frames": len(info.frames),
        "frame_types": dict(Counter(f.frame_type for f in info.frames)),
        "codec_bytes": info.num_bytes,
        "codec_p_bytes": ours_p,
        "codec_p_bytes_by_attribute": dict(by_attribute),
        "largest_errors": {k: e.maximum for k, e in report.errors.items() if e.count},
    }
    for form, frames in _forms(sizes):
        inter = [f for i, f in enumerate(frames) if i % _GOF_SIZE]
        key = "turn" if form == "TURN" else "quaternion"
        p_bytes, file_bytes = _total(inter, form), _total(frames, form)
        result[f"zstd_{key}"] = {
            "p_bytes": p_bytes,
            "file_bytes": file_bytes,
            "p_ratio": round(ours_p / p_bytes, 4),
            "file_ratio": round(info.num_bytes / file_bytes, 4),
        }
    totals: Counter[str] = Counter()
    for f in sizes[1:_GOF_SIZE]:
        totals.update(f)
    result["zstd_p_bytes_by_attribute"] = dict(totals)
    return result


def main() -> None:
    """Measure all scenes and write the result."""
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, frames in SCENES.items():
            results[name] = compare(name, MemorySource(frames()), Path(folder))
            print(name, {k: v for k, v in results[name].items() if k.startswith("zstd_") and "attr" not in k})
    conditions = {"qp": _OPTIONS.qp, "gof_size": _GOF_SIZE, "zero_bin": 0.5, "zstd_level": 19}
    print(write_result("against_zstd", conditions, results))


if __name__ == "__main__":
    main()
