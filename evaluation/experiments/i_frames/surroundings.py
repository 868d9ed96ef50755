"""Does an object come out as well in a room as alone?

    python -m evaluation.experiments.i_frames.surroundings [--splats NAME]

A trained splat as a sequence of one frame, alone and in generated surroundings
(`lab.scenes.surroundings`), looked at from around the object, what is behind it in sight. Ours, and
without the parts of the encoder that look at the whole scene. Bytes and squared errors are means over the
seeds; `bd_rate`: against the default.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from collections.abc import Sequence as Arguments
from typing import Any

import numpy as np

from dfcgs_codec import GaussianCloud
from evaluation.bd import bd_delta
from evaluation.experiments.i_frames.intra import SPLATS
from evaluation.experiments.i_frames.quantised_input import coded
from lab.assets import present
from lab.options import encoder_options
from lab.quality import frame_quality, image, psnr
from lab.record import known_results, write_result
from lab.render import Camera, orbit
from lab.scenes.surroundings import SURROUNDINGS

ALONE = "alone"
QPS = (18, 23, 28, 33)
SEEDS = (0, 1)
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "no balance": {"balance": False},
    "uniform": {"visibility": False, "balance": False},
}
_ANGLES = ((20.0, 10.0), (80.0, 30.0), (140.0, -5.0), (200.0, 40.0), (260.0, 5.0), (320.0, 20.0))
_SIZE, _FOV = (320, 240), 50.0
_NAMES = ("plant_sh0_part", "playbot_31k_sh2", "sushi_sh3_part")


def views(cloud: GaussianCloud) -> list[Camera]:
    """Cameras around an object, which fills their images."""
    positions = cloud.positions.astype(np.float64)
    low, high = np.percentile(positions, [2, 98], axis=0)
    distance = 0.5 * float(np.linalg.norm(high - low)) / np.sin(np.radians(_FOV / 2))
    middle = np.median(positions, axis=0).tolist()
    return [orbit(middle, distance, angles, _SIZE, _FOV) for angles in _ANGLES]


def scenes(cloud: GaussianCloud, name: str) -> Iterator[GaussianCloud]:
    """The object in surroundings `name`, once for each seed; alone there is nothing to draw lots for."""
    if name == ALONE:
        yield cloud
        return
    for seed in SEEDS:
        yield SURROUNDINGS[name](cloud, seed)


def compare(cloud: GaussianCloud, name: str) -> dict[str, Any]:
    """Points of every variant, and their BD-rates against the default."""
    cameras, found = views(cloud), list(scenes(cloud, name))
    sums = {variant: np.zeros((len(QPS), 2)) for variant in VARIANTS}
    for scene in found:
        sources = [image(scene, camera) for camera in cameras]
        for variant, changes in VARIANTS.items():
            for row, qp in enumerate(QPS):
                size, _, decoded = coded(scene, encoder_options(qp=qp, **changes))
                error = frame_quality(0, sources, decoded, cameras).visible.mse
                sums[variant][row] += np.array([size, error]) / len(found)
    points = {v: [(float(size), psnr(float(error))) for size, error in rows] for v, rows in sums.items()}
    result: dict[str, Any] = {"num_gaussians": found[0].num_gaussians}
    for variant, curve in points.items():
        delta = bd_delta(points["default"], curve)
        result[variant] = {
            "points": [{"qp": qp, "bytes": b, "psnr": p} for qp, (b, p) in zip(QPS, curve, strict=True)],
            "bd_rate": None if delta is None else round(delta.bd_rate, 2),
        }
    return result


def main(arguments: Arguments[str] | None = None) -> None:
    """Measure the splats that are there and write the result after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splats", nargs="*", default=list(_NAMES), help="only these")
    args = parser.parse_args(arguments)
    results = known_results("surroundings")
    for splat in present(SPLATS, args.splats):
        found = results.setdefault(splat.name, {})
        for name in (ALONE, *SURROUNDINGS):
            found[name] = compare(splat.cloud(), name)
            print(splat.name, name, {v: found[name][v]["bd_rate"] for v in VARIANTS}, flush=True)
        conditions = {
            "qps": QPS,
            "seeds": SEEDS,
            "variants": VARIANTS,
            "psnr": f"identical source, {len(_ANGLES)} views around the object at {_SIZE[0]}x{_SIZE[1]}",
        }
        print(write_result("surroundings", conditions, results))


if __name__ == "__main__":
    main()
