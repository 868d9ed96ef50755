"""What control points alone achieve, by both rules.

    python -m evaluation.experiments.paper.compensation [--scenes NAME ...]

Large scenes that move smoothly are coded with motion and no residual (`motion="only"`): by the main rule, by
the paper's, and not at all, which repeats the decoded I-frame. All three begin with the same I-frame. Every
P-frame is rendered and compared with its source from three views; bytes are those of P-frames. `paper_best`
is the paper's rule with the best motions there are (`spread_bound`), whose bytes are not counted.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence as Arguments
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence, probe
from dfcgs_codec.bitstream.constants import Compensation
from dfcgs_codec.encoder.tuning import MotionMode
from evaluation.experiments.paper.profile import Images, psnrs
from evaluation.experiments.paper.spread_bound import best_spread
from lab.assets import find_asset, present
from lab.quality import image
from lab.record import known_results, write_result
from lab.render import Camera
from lab.scenes.catalogue import Scene
from lab.scenes.catalogue import scene as named_scene
from lab.views import FEW, cameras

#: frames of the paper's GoF
NUM_FRAMES = 10
QPS = (21, 28)
_PAPER = EncoderOptions(tuning=EncoderTuning(motion=MotionMode.ONLY, compensation=Compensation.SPREAD))
#: settings by what they are called in the result
SETTINGS = {
    "main": EncoderOptions(tuning=EncoderTuning(motion=MotionMode.ONLY)),
    "main_m280": EncoderOptions(tuning=EncoderTuning(motion=MotionMode.ONLY, control_spacing=280)),
    "paper": _PAPER,
    "paper_k60": _PAPER.tuned(num_neighbours=60),
    "paper_k120": _PAPER.tuned(num_neighbours=120),
}
REPEAT, BEST = "repeat", "paper_best"

Figures = dict[str, Any]


def scenes() -> dict[str, Scene]:
    """100 000 Gaussians and more, all smooth."""
    large = {name: named_scene(name) for name in ("plant_sway", "mage_spell")}
    return large | {"knight_walk_200k": replace(named_scene("knight_walk"), num_gaussians=200_000)}


def _figures(images: Images, clouds: list[GaussianCloud], views: list[Camera]) -> Figures:
    """PSNR over all P-frames and of each."""
    pooled, by_frame = psnrs(images, clouds, views)
    return {"psnr": pooled, "psnr_by_frame": by_frame}


def _gof(frames: list[GaussianCloud], options: EncoderOptions, folder: Path) -> tuple[Figures, list]:
    """One GoF of `frames`: what it takes, and what is decoded."""
    path = folder / "gof.dgs"
    encode_sequence(frames, path, replace(options, gof_size=len(frames)), force=True)
    info = probe(path)
    kinds = "".join(frame.frame_type[0] for frame in info.frames)
    if kinds[0] != "I" or "I" in kinds[1:]:
        raise RuntimeError(f"one I-frame and P-frames were expected, not {kinds}")
    figures = {
        "bytes_i": info.frames[0].num_bytes,
        "bytes_p": sum(frame.num_bytes for frame in info.frames[1:]),
        "control_points": [frame.control_points for frame in info.frames[1:]],
    }
    return figures, [frame.cloud() for frame in decode_sequence(path)]


def measure(
    frames: list[GaussianCloud], images: Images, views: list[Camera], qp: float, folder: Path
) -> Figures:
    """All settings at one QP; `images` are those of the source's P-frames."""
    result: Figures = {}
    first: GaussianCloud | None = None
    for name, options in SETTINGS.items():
        figures, decoded = _gof(frames, replace(options, qp=qp), folder)
        result[name] = figures | _figures(images, decoded[1:], views)
        if first is not None and not np.array_equal(first.positions, decoded[0].positions):
            raise RuntimeError("the I-frames differ")
        if first is None:
            first = decoded[0]
            still = [first] * (len(frames) - 1)
            result[REPEAT] = {"bytes_p": 0} | _figures(images, still, views)
    result[BEST] = _figures(images, list(best_spread(frames, qp)), views)
    return result | {"against": compare(result)}


def compare(result: Figures) -> Figures:
    """Decibel of `main` over the others, pooled and in the worst frame, and its bytes over the paper's."""
    main = result["main"]
    found: Figures = {"bytes_ratio": round(main["bytes_p"] / max(1, result["paper"]["bytes_p"]), 4)}
    for name in ("paper", BEST, REPEAT):
        other = result[name]
        pairs = zip(main["psnr_by_frame"], other["psnr_by_frame"], strict=True)
        # None: equal images
        differences = [a - b for a, b in pairs if a is not None and b is not None]
        found[name] = {
            "gain": round(main["psnr"] - other["psnr"], 3),
            "least_gain": round(min(differences), 3),
        }
    return found


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=list(scenes()), help="only these")
    args = parser.parse_args(arguments)
    results = known_results("compensation")
    conditions = {"frames": NUM_FRAMES, "qps": QPS, "views": FEW, "settings": list(SETTINGS)}
    for name in args.scenes:
        scene = scenes()[name]
        if not list(present([scene])):
            continue
        frames = list(islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
        views = cameras(scene.name, FEW)
        images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
        results[name] = {"num_gaussians": frames[0].num_gaussians, "sh_degree": frames[0].sh_degree}
        with tempfile.TemporaryDirectory() as folder:
            for qp in QPS:
                results[name][f"qp{qp}"] = found = measure(frames, images, views, qp, Path(folder))
                for setting in (*SETTINGS, REPEAT, BEST):
                    row = found[setting]
                    size = row.get("bytes_p", "")
                    print(f"{name} qp{qp} {setting:10} {size:>9} {row['psnr']:.2f} dB", flush=True)
                print(f"{name} qp{qp} {found['against']}", flush=True)
        path = write_result("compensation", conditions, results)
    print(path)


if __name__ == "__main__":
    main()
