"""The operating points of the comparison: a method at a setting, as two commands on folders."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dfcgs_codec.encoder.plan.quantiser_steps import QUALITIES
from evaluation.baselines.catalogue import METHODS
from evaluation.baselines.method import Method, SequenceFacts
from lab.record import REPOSITORY

Command = list[str]
#: fields of EncoderOptions by name, as JSON has them; `tuning` is a dict of EncoderTuning's
Options = dict[str, Any]

#: QPs between and beyond the presets, so that curves reach what the others offer
_MORE_QPS = (40,)
#: QPs of a typical scene at `high`, `medium` and `low`: those of the curves beside the default one
CURVE_QPS = (18, 28, 34)
#: QPs of uniform steps, from below what `low` shows to about `transparent`; images of rooms fall apart
#: at once where steps become coarser than what stands before the camera
_UNIFORM_QPS = (28, 23, 18, 13, 8)
#: our curves: label and further EncoderOptions, `tuning` as a dict
CODEC_CURVES: dict[str, tuple[str, Options]] = {
    "dfcgs": ("dfcgs (default)", {}),
    "dfcgs_still": ("dfcgs, no motion", {"tuning": {"motion": "off"}}),
    "dfcgs_gof10": ("dfcgs, GoF 10", {"gof_size": 10}),
    "dfcgs_intra": ("dfcgs, I-frames only", {"gof_size": 1}),
    "dfcgs_paper": ("dfcgs, profile paper", {"profile": "paper"}),
    "dfcgs_uniform": ("dfcgs, uniform steps", {"tuning": {"visibility": False}}),
    "dfcgs_views": ("dfcgs, told its cameras", {}),
}
_PYTHON = sys.executable
_FILE = "sequence.dgs"


@dataclass(frozen=True)
class Point:
    """encode: (frames folder, target folder) -> command; decode: (target folder, frames folder) -> command.

    sample: how many frames it is measured on, where it codes frames alone and slowly; None for all.
    preset: the quality name where it is one of ours. version: what decides the bytes, for the cache.
    """

    method: str
    label: str
    setting: str
    preset: str | None
    version: Callable[[], str]
    accepts: Callable[[SequenceFacts], str | None]
    encode: Callable[[Path, Path], Command]
    decode: Callable[[Path, Path], Command]
    sample: int | None = None

    @property
    def is_ours(self) -> bool:
        """Whether it is this codec."""
        return self.method in CODEC_CURVES


def codec_version() -> str:
    """A digest of the codec's sources."""
    total = hashlib.sha256()
    sources = [path for path in (REPOSITORY / "src").rglob("*") if path.suffix in (".py", ".weights")]
    for path in sorted(sources):
        total.update(path.read_bytes())
    return total.hexdigest()[:16]


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def codec_point(method: str, setting: str, options: Options, preset: str | None = None) -> Point:
    """`dfcgs encode` with `options`, as a user would run it; `evaluation.tuned` where some are for Python."""
    label, more = CODEC_CURVES[method]
    wanted = more | options
    module = [_PYTHON, "-m", "dfcgs_codec"]

    def encode(frames: Path, target: Path) -> Command:
        files = [str(frames), str(target / _FILE)]
        if "tuning" in wanted:
            return [_PYTHON, "-m", "evaluation.tuned", *files, json.dumps(wanted)]
        flags = [text for name, value in wanted.items() for text in (_flag(name), str(value))]
        return [*module, "encode", *files, "--quiet", "--json", *flags]

    def decode(target: Path, frames: Path) -> Command:
        return [*module, "decode", str(target / _FILE), str(frames), "--quiet", "--force"]

    return Point(method, label, setting, preset, codec_version, lambda _: None, encode, decode)


def codec_points() -> list[Point]:
    """Presets and more QPs on the default curve; QPs alone on the others."""
    points = [codec_point("dfcgs", name, {"quality": name}, name) for name in QUALITIES]
    points += [codec_point("dfcgs", f"qp{qp}", {"qp": qp}) for qp in _MORE_QPS]
    for method in ("dfcgs_still", "dfcgs_gof10", "dfcgs_intra", "dfcgs_paper"):
        points += [codec_point(method, f"qp{qp}", {"qp": qp}) for qp in CURVE_QPS]
    return points


def capture_points(cameras: Path) -> list[Point]:
    """What is asked of captures beside: steps that heed nothing, and presets told where the cameras stood."""
    points = [codec_point("dfcgs_uniform", f"qp{qp}", {"qp": qp}) for qp in _UNIFORM_QPS]
    digest = hashlib.sha256(cameras.read_bytes()).hexdigest()[:16]
    told = [codec_point("dfcgs_views", name, {"quality": name, "views": str(cameras)}) for name in QUALITIES]
    return points + [replace(point, version=lambda: f"{codec_version()} {digest}") for point in told]


def _baseline_point(method: Method, setting: str) -> Point:
    module = [_PYTHON, "-m", "evaluation.baselines"]
    return Point(
        method.name,
        method.label,
        setting,
        None,
        method.version,
        method.accepts,
        lambda frames, target: [*module, "encode", method.name, setting, str(frames), str(target)],
        lambda target, frames: [*module, "decode", method.name, str(target), str(frames)],
        method.sample,
    )


def baseline_points() -> list[Point]:
    """Every baseline at every setting."""
    return [_baseline_point(method, setting) for method in METHODS.values() for setting in method.settings]
