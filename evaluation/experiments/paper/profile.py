"""The profile `paper` on our scenes: `python -m evaluation.experiments.paper.profile [--scenes NAME ...]`.

One GoF of 10 frames of every evaluation scene, `paper` and `main` with the same I-frames, so that P-frames
alone differ. Every P-frame is rendered and compared with its source from three views, and so is what
repeating the frame before would show. Figures land in `evaluation/results/paper_profile.json` after every
scene. Seconds are those of this process for a P-frame, files read and written included.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence as Arguments
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import IntraKind, Profile
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from lab.assets import find_asset, present
from lab.quality import Image, Pool, frame_quality, image, psnr
from lab.record import known_results, write_result
from lab.render import Camera
from lab.scenes.catalogue import group
from lab.views import FEW, cameras

#: the paper's L
NUM_FRAMES = 10
QP = 28
PAPER = EncoderOptions(profile=Profile.PAPER, qp=QP, gof_size=NUM_FRAMES)
MAIN = EncoderOptions(qp=QP, gof_size=NUM_FRAMES)
#: settings by what they are called in the result; those of one QP share their I-frames
SETTINGS: dict[str, EncoderOptions] = {
    **{f"paper, q' = {step:g}": PAPER.tuned(latent_step=step) for step in (0.5, 1, 2, 4)},
    "paper, refined": PAPER.tuned(refinement=RefinementMode.ON),
    "paper, qp18": replace(PAPER, qp=18),
    "paper, qp34": replace(PAPER, qp=34),
    "paper, ply I-frames": PAPER.tuned(intra=IntraKind.PLY),
    "main, no residual": MAIN.tuned(motion=MotionMode.ONLY),
    "main": MAIN,
    "main, qp18": replace(MAIN, qp=18),
    "main, qp34": replace(MAIN, qp=34),
}
#: a P-frame may be this much below the frame before, decibel
ALLOWANCE = 0.05

Images = list[list[Image]]
Figures = dict[str, Any]


def _coded(frames: list[GaussianCloud], options: EncoderOptions, folder: Path) -> tuple[Figures, list]:
    """One GoF: what it takes, and what is decoded."""
    path = folder / "gof.dgs"
    start = time.perf_counter()
    encode_sequence(frames, path, options, force=True)
    coded = time.perf_counter()
    decoded = [frame.cloud() for frame in decode_sequence(path)]
    done = time.perf_counter()
    info = probe(path)
    inter = [frame for frame in info.frames if frame.frame_type != "I"]
    figures = {
        "bytes": info.num_bytes,
        "bytes_p": sum(frame.num_bytes for frame in inter),
        "frame_types": "".join(frame.frame_type[0] for frame in info.frames),
        "bytes_by_chunk_type": dict(info.chunk_bytes),
        "encode_s_per_frame": round((coded - start) / len(frames), 4),
        "decode_s_per_frame": round((done - coded) / len(frames), 4),
    }
    return figures, decoded


def psnrs(images: Images, clouds: list[GaussianCloud], views: list[Camera]) -> tuple[float | None, list]:
    """Pooled over P-frames, and of each."""
    rated = [
        frame_quality(index, found, cloud, views)
        for index, (found, cloud) in enumerate(zip(images, clouds, strict=True), 1)
    ]
    pooled = Pool(sum(f.visible.squared for f in rated), sum(f.visible.count for f in rated))
    by_frame = [psnr(f.visible.mse) for f in rated]
    return psnr(pooled.mse), [None if value is None else round(value, 3) for value in by_frame]


def measure(
    frames: list[GaussianCloud],
    images: Images,
    views: list[Camera],
    options: EncoderOptions,
    folder: Path,
) -> Figures:
    """A setting on the frames of a GoF; `images` are those of the source's P-frames."""
    figures, decoded = _coded(frames, options, folder)
    figures["psnr"], figures["psnr_by_frame"] = psnrs(images, decoded[1:], views)
    if options.profile == Profile.PAPER:
        _, repeated = psnrs(images, decoded[:-1], views)
        figures["repeated_by_frame"] = repeated
        figures["least_gain"] = least_gain(figures["psnr_by_frame"], repeated)
    return figures


def least_gain(found: list[float | None], repeated: list[float | None]) -> float:
    """Decibel over the frame before, in the worst P-frame; frames that equal their source count as 99 dB."""
    pairs = [
        (99.0 if a is None else a, 99.0 if b is None else b) for a, b in zip(found, repeated, strict=True)
    ]
    return round(min(a - b for a, b in pairs), 3)


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=[], help="only these")
    args = parser.parse_args(arguments)
    results = known_results("paper_profile")
    missed = []
    for scene in present(group("evaluation"), args.scenes):
        frames = list(islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
        views = cameras(scene.name, FEW)
        images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
        rows: Figures = {}
        with tempfile.TemporaryDirectory() as folder:
            for name, options in SETTINGS.items():
                rows[name] = row = measure(frames, images, views, options, Path(folder))
                print(f"{scene.name:24} {name:26} {row['bytes_p']:9} {row['psnr'] or 99:.2f} dB", flush=True)
                if row.get("least_gain", 0.0) < -ALLOWANCE:
                    missed.append(f"{scene.name}, {name}: {row['least_gain']} dB over the frame before")
        results[scene.name] = {"num_gaussians": frames[0].num_gaussians, "settings": rows}
        conditions = {"frames": NUM_FRAMES, "qp": QP, "views": FEW}
        path = write_result("paper_profile", conditions, results)
    print(path)
    if missed:
        raise SystemExit("\n".join(missed))


if __name__ == "__main__":
    main()
