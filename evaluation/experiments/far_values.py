"""Does one far Gaussian spoil a scene?

    python -m evaluation.experiments.far_values [SCENE ...]

Fails where it does.

Sequences of four frames, with one Gaussian far away in the first, a middle, the last, or every frame, against
the same sequence without: bytes a frame more, and PSNR lost by all others in the frames in which it is far.
Without is without that Gaussian where it is far in the first frame, else with it in its place. The same is
measured with the Gaussian moved by a hair (`far` 0): where that changes as much, it is not the distance:
another rounding swaps Gaussians in depth.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import OutputOrder
from dfcgs_codec.ply import read_ply
from evaluation.experiments.i_frames.surroundings import views
from lab.assets import find_asset
from lab.quality import frame_quality, image, psnr
from lab.record import write_result
from lab.render import Camera
from lab.scenes import SceneOptions, animated_sequence, trained_sequence
from lab.scenes.surroundings import SURROUNDINGS

NUM_FRAMES = 4
FAR = (0.0, 1e3, 1e12)
WHERE = {"first": (0,), "middle": (2,), "last": (3,), "every": (0, 1, 2, 3)}
QUALITIES = {"medium": 28, "transparent": 8}
MOST_DECIBEL, MOST_BYTES = 0.1, 64.0
_GAUSSIAN, _HAIR = 7, 1e-3


def _scenes() -> Iterator[tuple[str, list[GaussianCloud], list[Camera]]]:
    splat, _ = read_ply(find_asset("playbot_31k_sh2.ply"))
    options = SceneOptions(NUM_FRAMES)
    yield "splat", list(trained_sequence(splat, options, "part")), views(splat)[:2]
    fox = list(animated_sequence(find_asset("Fox.glb"), SceneOptions(NUM_FRAMES, 20_000, 1), "Run"))
    yield "character", fox, views(fox[0])[:2]
    room = SURROUNDINGS["room"](splat, 0)
    yield "room", list(trained_sequence(room, options, "part")), views(splat)[:2]


def _with_far_one(frames: list[GaussianCloud], where: tuple[int, ...], far: float) -> list[GaussianCloud]:
    changed = list(frames)
    for index in where:
        positions = frames[index].positions.copy()
        positions[_GAUSSIAN] = [far, far / 2, -far] if far else positions[_GAUSSIAN] + np.float32(_HAIR)
        changed[index] = replace(frames[index], positions=positions)
    return changed


def _without(frame: GaussianCloud) -> GaussianCloud:
    return frame.take(np.delete(np.arange(frame.num_gaussians), _GAUSSIAN))


def _coded(
    frames: list[GaussianCloud],
    cameras: list[Camera],
    rated: tuple[int, ...],
    qp: float,
    others: Callable[[GaussianCloud], GaussianCloud] = _without,
) -> tuple[int, dict[int, float]]:
    """Bytes of the file, and PSNR of some frames' `others`."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "a.dgs"
        options = EncoderOptions(qp=qp, order=OutputOrder.INPUT, jobs=1)
        size = encode_sequence(frames, target, options).num_bytes
        decoded = [frame.cloud() for frame in decode_sequence(target)]
    found = {}
    for index in rated:
        source = [image(others(frames[index]), camera) for camera in cameras]
        error = frame_quality(index, source, others(decoded[index]), cameras).visible.mse
        found[index] = psnr(error) or np.inf
    return size, found


def _misses(row: dict[str, Any], rows: list[dict[str, Any]]) -> bool:
    """Whether a row is beyond a bar, and beyond what any change of the Gaussian does."""
    same = [r for r in rows if not r["far"] and (r["scene"], r["quality"]) == (row["scene"], row["quality"])]
    decibel = max(MOST_DECIBEL, *(abs(r["psnr_lost"]) for r in same))
    more = max(MOST_BYTES, *(abs(r["bytes_per_frame_more"]) for r in same))
    return bool(row["psnr_lost"] > decibel or row["bytes_per_frame_more"] > more)


def main() -> int:
    """Measure all, write the result, say what missed."""
    rows: list[dict[str, Any]] = []
    wanted = sys.argv[1:]
    for (scene, frames, cameras), (quality, qp) in product(_scenes(), QUALITIES.items()):
        if wanted and scene not in wanted:
            continue
        everywhere = tuple(range(NUM_FRAMES))
        in_place = _coded(frames, cameras, everywhere, qp)
        gone = _coded([_without(frame) for frame in frames], cameras, everywhere, qp, lambda frame: frame)
        for place, where in WHERE.items():
            for far in FAR:
                plain_bytes, plain = gone if 0 in where and far else in_place
                size, rated = _coded(_with_far_one(frames, where, far), cameras, where, qp)
                worse = max(plain[index] - rated[index] for index in where)
                more = (size - plain_bytes) / NUM_FRAMES
                row = {"scene": scene, "quality": quality, "where": place, "far": far}
                rows.append(row | {"psnr_lost": round(worse, 3), "bytes_per_frame_more": round(more, 1)})
                print(rows[-1], flush=True)
    missed = [row for row in rows if _misses(row, rows)]
    write_result("far_values", {"frames": NUM_FRAMES, "bars": [MOST_DECIBEL, MOST_BYTES]}, rows)
    for row in missed:
        print(f"missed: {row}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
