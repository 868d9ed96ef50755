"""The tables of the paper on our scenes.

    python -m evaluation.experiments.paper.ablations [--models FOLDER]

Sensitivity to K, M and L; control points against none (every Gaussian its own motion); and models other than
the one of the package: without hyperprior, prior or refinement, or with fewer bits. FOLDER holds them as
`<name>.weights` (`python -m training.paper`); without it their rows stay as they were. Bytes and PSNR are of
P-frames; figures land in `evaluation/results/paper_ablations.json` after every scene.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from collections.abc import Sequence as Arguments
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, GaussianCloud
from dfcgs_codec.encoder.plan.tuning import RefinementMode
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.model.registry import load_model, register
from evaluation.experiments.paper.profile import NUM_FRAMES, PAPER, QP, measure
from lab.assets import find_asset, present
from lab.quality import image
from lab.record import known_results, write_result
from lab.scenes.catalogue import scene as named_scene
from lab.views import FEW, cameras

SCENES = ("knight_walk", "mage_fitted", "lumberjack_walk_noisy")
LONG_FRAMES = 32
#: with one control point a Gaussian there may be no more
SMALL = 16_000
SETTINGS: dict[str, EncoderOptions] = {
    "default": PAPER,
    "K = 60": PAPER.tuned(num_neighbours=60),
    "K = 120": PAPER.tuned(num_neighbours=120),
    "M = 140": PAPER.tuned(control_spacing=140),
    "M = 280": PAPER.tuned(control_spacing=280),
    "refinement in every frame": PAPER.tuned(refinement=RefinementMode.ON),
    "refinement off": PAPER.tuned(refinement=RefinementMode.OFF),
}
#: on more frames
LONG = {f"L = {size}": replace(PAPER, gof_size=size) for size in (4, 10, LONG_FRAMES)}
#: on fewer Gaussians
WITH_POINTS, WITHOUT_POINTS = "control points", "no control points"
#: the model that was fine-tuned to move every Gaussian by itself
DENSE = "dense"

Figures = dict[str, Any]


def _rows(
    name: str, frames: list[GaussianCloud], settings: dict[str, EncoderOptions]
) -> Iterator[tuple[str, Figures]]:
    """Every setting on `frames`."""
    views = cameras(name, FEW)
    images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
    with tempfile.TemporaryDirectory() as folder:
        for setting, options in settings.items():
            row = measure(frames, images, views, options, Path(folder))
            count = max(1, len(frames) - row["frame_types"].count("I"))
            row["bytes_per_p"] = round(row["bytes_p"] / count, 1)
            print(f"{name:22} {setting:26} {row['bytes_per_p']:9} {row['psnr']:.3f} dB", flush=True)
            yield setting, row


def _without(folder: Path | None) -> dict[str, EncoderOptions]:
    """Control points and none; the latter needs a model of its own, for nothing is spread."""
    if folder is None or not (folder / f"{DENSE}.weights").exists():
        return {}
    register(load_model(folder / f"{DENSE}.weights"))
    dense = PAPER.tuned(control_spacing=1, num_neighbours=1, model_id=DENSE)
    return {WITH_POINTS: PAPER, WITHOUT_POINTS: dense}


def _models(folder: Path | None) -> dict[str, EncoderOptions]:
    """Settings of the models in a folder, which become known to the codec."""
    found = {}
    for path in sorted(folder.glob("*.weights")) if folder else []:
        if path.stem == DENSE:
            continue
        model = load_model(path)
        assert isinstance(model, LatentModel)
        register(model)
        mode = RefinementMode.ON if model.has_refinement else RefinementMode.OFF
        found[f"model {path.stem}"] = PAPER.tuned(model_id=model.model_id)
        found[f"model {path.stem}, refined"] = PAPER.tuned(model_id=model.model_id, refinement=mode)
    return found


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--models", type=Path, help="folder of further models")
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), help="only these")
    parser.add_argument("--only-models", action="store_true", help="leave the other rows as they are")
    args = parser.parse_args(arguments)
    results = known_results("paper_ablations")
    for scene in present(map(named_scene, args.scenes)):
        name = scene.name
        frames = list(islice(scene.frames(find_asset(scene.asset)), LONG_FRAMES))
        rows = results.setdefault(name, {})
        settings = {} if args.only_models else SETTINGS
        rows.update(_rows(name, frames[:NUM_FRAMES], settings | _models(args.models)))
        if not args.only_models:
            rows.update(_rows(name, frames, LONG))
        without = _without(args.models)
        if without and scene.num_gaussians is not None:
            small = replace(scene, num_gaussians=SMALL).frames(find_asset(scene.asset))
            rows.update(_rows(name, list(islice(small, NUM_FRAMES)), without))
        path = write_result("paper_ablations", {"frames": NUM_FRAMES, "qp": QP, "views": FEW}, results)
    print(path)


if __name__ == "__main__":
    main()
