"""One operating point on one sequence: bytes, seconds, memory, quality. Figures are cached by their input."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dfcgs_codec import probe
from dfcgs_codec.array_types import Float32
from dfcgs_codec.ply import read_ply
from evaluation.baselines.__main__ import EXIT_REFUSED, EXIT_UNAVAILABLE
from evaluation.baselines.method import MethodUnavailable, frame_path, frame_paths
from evaluation.fresh import Run, run_fresh
from evaluation.points import Point
from evaluation.sequences import WORK, Sequence
from lab.attribute_errors import attribute_errors
from lab.captures.files import true_images
from lab.quality import Image, compared, image, summary, true_quality
from lab.scenes.catalogue import is_capture
from lab.views import cameras

_CACHE = WORK / "cache"
#: a change of how things are measured, so that older figures are not taken for new ones
_MEASUREMENT = 1


@dataclass(frozen=True)
class Rated:
    """Which frames are rendered, and from which of the scene's views."""

    frames: tuple[int, ...]
    views: tuple[int, ...]


@dataclass(frozen=True)
class Subject:
    """A sequence and how it is rated; the images of the source are rendered once, when first needed."""

    sequence: Sequence
    rated: Rated

    @cached_property
    def source_images(self) -> dict[int, list[Image]]:
        """Images by frame, one per view."""
        views = cameras(self.sequence.name, self.rated.views)
        return {
            index: [image(self.sequence.frame(index), view) for view in views] for index in self.rated.frames
        }

    @cached_property
    def true_images(self) -> dict[int, list[Float32]]:
        """What a capture was fitted to, as seen from the views, by frame; nothing for other scenes."""
        name, views = self.sequence.name, self.rated.views
        if not is_capture(name):
            return {}
        return true_images(name, dict(zip(views, cameras(name, views), strict=True)), self.rated.frames)


def _skipped(reason: str) -> dict[str, Any]:
    return {"skipped": reason}


def _outcome(run: Run, direction: str) -> dict[str, Any] | None:
    """Why a run gave nothing, if so."""
    if run.exit_code == 0:
        return None
    if run.exit_code in (EXIT_UNAVAILABLE, EXIT_REFUSED):
        return _skipped(run.message)
    return {"failed": f"{direction}: {run.message}"}


def _folder_bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _bytes_by_kind(target: Path) -> dict[str, Any]:
    """Where our bytes go."""
    info = probe(target / "sequence.dgs")
    return {
        "bytes_by_frame_type": dict(info.bytes_by("frame_type")),
        "bytes_by_chunk_type": dict(info.chunk_bytes),
        "bytes_by_attribute": dict(info.bytes_by("attribute")),
        "frame_types": "".join(frame.frame_type for frame in info.frames),
    }


def _expected(encode: Run) -> dict[str, Any]:
    """The PSNR that our encoder expects, where its report has one."""
    report = json.loads(encode.output)
    return {"estimated_psnr": report["estimated_psnr"]} if "estimated_psnr" in report else {}


def _quality(subject: Subject, decoded: Path) -> dict[str, Any]:
    views = cameras(subject.sequence.name, subject.rated.views)
    clouds = {index: read_ply(frame_path(decoded, index))[0] for index in subject.rated.frames}
    images = {index: [image(cloud, view) for view in views] for index, cloud in clouds.items()}
    whole = is_capture(subject.sequence.name)
    rated = [compared(index, subject.source_images[index], seen, whole) for index, seen in images.items()]
    last = subject.rated.frames[-1]
    errors = {"attributes": attribute_errors(subject.sequence.frame(last), clouds[last])}
    return summary(rated) | _true_quality(subject, images) | errors


def _true_quality(subject: Subject, decoded: dict[int, list[Image]]) -> dict[str, Any]:
    """How near input and decoded frames of a capture are to the true images; nothing for other scenes."""
    if not subject.true_images:
        return {}
    result: dict[str, Any] = {}
    for name, images in (("input", subject.source_images), ("decoded", decoded)):
        result[f"psnr_true_{name}"], result[f"ssim_true_{name}"] = true_quality(subject.true_images, images)
    return result


def _times(encode: Run, decode: Run, frames: int) -> dict[str, Any]:
    return {
        "encode_s_per_frame": round(encode.seconds / frames, 4),
        "decode_s_per_frame": round(decode.seconds / frames, 4),
        "encode_peak_mib": encode.peak_mib,
        "decode_peak_mib": decode.peak_mib,
    }


def run_point(subject: Subject, point: Point, work: Path) -> dict[str, Any]:
    """Encode and decode in fresh processes, and rate what comes out."""
    facts = subject.sequence.facts
    target, decoded = work / "target", work / "decoded"
    target.mkdir()
    decoded.mkdir()
    encode = run_fresh(point.encode(subject.sequence.folder, target))
    if (bad := _outcome(encode, "encode")) is not None:
        return bad
    decode = run_fresh(point.decode(target, decoded))
    if (bad := _outcome(decode, "decode")) is not None:
        return bad
    if len(frame_paths(decoded)) != facts.num_frames:
        return {"failed": f"decode: {len(frame_paths(decoded))} of {facts.num_frames} frames"}
    size = _folder_bytes(target)
    result = {
        "bytes": size,
        "bytes_per_frame": size / facts.num_frames,
        "bits_per_gaussian": 8.0 * size / sum(facts.num_gaussians),
        **_times(encode, decode, facts.num_frames),
        **_quality(subject, decoded),
    }
    return result | ({**_bytes_by_kind(target), **_expected(encode)} if point.is_ours else {})


def _key(subject: Subject, point: Point) -> str:
    parts = [subject.sequence.digest, asdict(subject.rated), point.method, point.setting, point.version()]
    return hashlib.sha256(json.dumps([_MEASUREMENT, *parts]).encode()).hexdigest()[:32]


def measure(subject: Subject, point: Point, run: Callable[..., dict[str, Any]] = run_point) -> dict[str, Any]:
    """Figures of a point, from the cache if it was measured before; never raises for a method's failure."""
    if (refusal := point.accepts(subject.sequence.facts)) is not None:
        return _skipped(refusal)
    try:
        path = _CACHE / f"{_key(subject, point)}.json"
    except MethodUnavailable as error:
        return _skipped(str(error))
    if path.exists():
        cached: dict[str, Any] = json.loads(path.read_text())
        return cached
    WORK.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(dir=WORK))
    try:
        result = run(subject, point, work)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    if "skipped" not in result:
        _CACHE.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(result))
    return result
