"""What the presets promise, measured: `python -m evaluation.promise [--views] [SCENE...] [--preset NAME...]`.

The first frames of every scene of the evaluation, captures and long ones included: PSNR of all rendered
frames together (of what is visible; of whole images on captures), how far the worst frame is below, what the
encoder itself expects, bytes and seconds per frame. With `--views` captures are encoded for their cameras,
and stand beside the rows without. Rows that a run does not touch stay as they were.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence as Arguments
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence
from dfcgs_codec.encoder.plan.quantiser_steps import QUALITIES
from evaluation.measure import Rated, Subject
from evaluation.sequences import materialise
from lab.assets import present
from lab.captures.files import cameras_file
from lab.quality import frame_quality, summary
from lab.record import known_results, write_result
from lab.scenes.catalogue import Scene, group, is_capture
from lab.views import FEW, cameras

PRESETS = ("medium", "high", "transparent")
_NUM_FRAMES, _RENDER_EVERY = 10, 3
_GROUPS = ("evaluation", "captures", "long")

Figures = dict[str, Any]


def subject_of(scene: Scene, num_frames: int) -> Subject:
    """The first frames of a scene, some of them rendered from few views."""
    sequence = materialise(scene, num_frames)
    return Subject(sequence, Rated(tuple(range(0, sequence.facts.num_frames, _RENDER_EVERY)), FEW))


def rate(subject: Subject, options: EncoderOptions) -> Figures:
    """Encode, decode, and rate what comes out."""
    sequence, rated = subject.sequence, subject.rated
    frames = [sequence.frame(index) for index in range(sequence.facts.num_frames)]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "sequence.dgs"
        start = time.perf_counter()
        report = encode_sequence(frames, target, options)
        seconds = time.perf_counter() - start
        decoded = {i: frame.cloud() for i, frame in enumerate(decode_sequence(target)) if i in rated.frames}
    views, whole = cameras(sequence.name, rated.views), is_capture(sequence.name)
    sources = subject.source_images
    quality = summary(frame_quality(i, sources[i], cloud, views, whole) for i, cloud in decoded.items())
    mean, worst = quality["psnr"], quality["psnr_worst_frame"]
    return {
        "frames": len(frames),
        "psnr": mean,
        "worst_minus_mean": None if mean is None else worst - mean,
        "estimated_psnr": getattr(report, "estimated_psnr", None),
        "bytes_per_frame": report.num_bytes / len(frames),
        "encode_s_per_frame": seconds / len(frames),
        "kinds": "".join(frame.kind[0] for frame in report.frames),
        "psnr_by_frame": quality["psnr_by_frame"],
    }


def _line(name: str, setting: str, row: Figures) -> str:
    if row["psnr"] is None:
        return f"{name:24s} {setting:20s} equal images"
    expected = row["estimated_psnr"]
    shown = "  -  (  -  )" if expected is None else f"{expected:5.2f} ({expected - row['psnr']:+5.2f})"
    return (
        f"{name:24s} {setting:20s} {row['psnr']:6.2f} dB  worst {row['worst_minus_mean']:+5.2f}  "
        f"expected {shown}  {row['bytes_per_frame'] / 1000:8.1f} kB/frame  "
        f"{row['encode_s_per_frame']:6.2f} s/frame  {row['kinds']}"
    )


def rate_scene(scene: Scene, presets: Arguments[str], num_frames: int, views: bool) -> Figures:
    """Rows of a scene by preset."""
    subject = subject_of(scene, num_frames)
    with_views = views and is_capture(scene.name)
    more: dict[str, Any] = {"views": cameras_file(scene.name)} if with_views else {}
    rows = {}
    for preset in presets:
        setting = f"{preset} --views" if with_views else preset
        rows[setting] = rate(subject, EncoderOptions(quality=preset, **more))
        print(_line(scene.name, setting, rows[setting]), flush=True)
    return rows


def main(arguments: Arguments[str] | None = None) -> int:
    """Measure, and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    known = [scene for name in _GROUPS for scene in group(name)]  # type: ignore[arg-type]
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="only these")
    parser.add_argument("--preset", nargs="*", choices=list(QUALITIES), default=list(PRESETS))
    parser.add_argument("--frames", type=int, default=_NUM_FRAMES, help="how many of each scene")
    parser.add_argument("--views", action="store_true", help="encode captures for their cameras")
    args = parser.parse_args(arguments)
    if unknown := set(args.scenes) - {scene.name for scene in known}:
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(s.name for s in known)}")
    results = known_results("promise")
    for scene in present(known, args.scenes):
        rows = rate_scene(scene, args.preset, args.frames, args.views)
        results[scene.name] = results.get(scene.name, {}) | rows
        write_result("promise", {"render_every": _RENDER_EVERY}, results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
