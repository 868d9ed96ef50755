"""The tables of the paper on our scenes: `python -m evaluation.paper_ablations [--models FOLDER]`.

Sensitivity to K, M and L; control points against none (every Gaussian its own motion); and models other than
the one of the package: without hyperprior, prior or refinement, or with fewer bits. FOLDER holds them as
`<name>.npz` (`python -m training.paper`); without it their rows stay as they were. Bytes and PSNR are those
of P-frames; figures land in `evaluation/results/paper_ablations.json` after every scene.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from collections.abc import Sequence as Arguments
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any
from unittest import mock

from dfcgs_codec import EncoderOptions, GaussianCloud, encode_sequence
from dfcgs_codec.codec.decoder import SequenceDecoder
from dfcgs_codec.codec.dpb import FrameState, output
from dfcgs_codec.codec.gof_decoder import GofDecoder
from dfcgs_codec.codec.gof_state import GofState
from dfcgs_codec.codec.latent_motion import LatentReference
from dfcgs_codec.encoder.options import RefinementMode
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.model.registry import latent_model, load_model, register
from evaluation.assets import find_asset, has_asset
from evaluation.bench import known_results
from evaluation.paper_profile import NUM_FRAMES, PAPER, QP, measure, psnrs
from evaluation.quality import image
from evaluation.record import write_result
from evaluation.views import FEW, cameras
from training.scenes.catalogue import scene as named_scene

SCENES = ("knight_walk", "mage_fitted", "lumberjack_walk_noisy")
LONG_FRAMES = 32
#: with one control point a Gaussian there may be no more
SMALL = 16_000
SETTINGS: dict[str, EncoderOptions] = {
    "default": PAPER,
    "K = 60": replace(PAPER, num_neighbours=60),
    "K = 120": replace(PAPER, num_neighbours=120),
    "M = 140": replace(PAPER, control_spacing=140),
    "M = 280": replace(PAPER, control_spacing=280),
    "refinement in every frame": replace(PAPER, refinement=RefinementMode.ON),
    "refinement off": replace(PAPER, refinement=RefinementMode.OFF),
}
#: on more frames
LONG = {f"L = {size}": replace(PAPER, gof_size=size) for size in (4, 10, LONG_FRAMES)}
#: refined after decoding, the reference untouched
OUTSIDE = "refinement outside the loop"
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


def refined_outside(frames: list[GaussianCloud], folder: Path) -> list[GaussianCloud]:
    """P-frames coded without refinement, refined when they are shown: the reference stays as it was."""
    path, states = folder / "outside.dgs", []
    keep = GofDecoder._keep

    def remember(self: GofDecoder, state: GofState, *about: Any) -> FrameState:
        states.append(state)
        return keep(self, state, *about)

    encode_sequence(frames, path, replace(PAPER, refinement=RefinementMode.OFF), force=True)
    with mock.patch.object(GofDecoder, "_keep", remember), path.open("rb") as file:
        decoder = SequenceDecoder(file)
        for _ in decoder.frames():
            pass
    units, model = decoder.sequence.unit_exponents, latent_model(decoder.sequence.model_id)
    return [
        output(LatentReference(model, before, units).refined(after.frame), units)
        for before, after in pairwise(states)
    ]


def _outside(name: str, frames: list[GaussianCloud], rows: Figures) -> None:
    """The PSNR of P-frames refined outside the loop, at the bytes of those that are not refined."""
    views = cameras(name, FEW)
    images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
    with tempfile.TemporaryDirectory() as folder:
        found, by_frame = psnrs(images, refined_outside(frames, Path(folder)), views)
    rows[OUTSIDE] = rows["refinement off"] | {"psnr": found, "psnr_by_frame": by_frame}
    print(f"{name:22} {OUTSIDE:26} {found:.3f} dB", flush=True)


def _without(folder: Path | None) -> dict[str, EncoderOptions]:
    """Control points and none; the latter needs a model of its own, for nothing is spread."""
    if folder is None or not (folder / f"{DENSE}.npz").exists():
        return {}
    register(load_model(folder / f"{DENSE}.npz"))
    dense = replace(PAPER, control_spacing=1, num_neighbours=1, model_id=DENSE)
    return {WITH_POINTS: PAPER, WITHOUT_POINTS: dense}


def _models(folder: Path | None) -> dict[str, EncoderOptions]:
    """Settings of the models in a folder, which become known to the codec."""
    found = {}
    for path in sorted(folder.glob("*.npz")) if folder else []:
        if path.stem == DENSE:
            continue
        model = load_model(path)
        assert isinstance(model, LatentModel)
        register(model)
        mode = RefinementMode.ON if model.has_refinement else RefinementMode.OFF
        found[f"model {path.stem}"] = replace(PAPER, model_id=model.model_id)
        found[f"model {path.stem}, refined"] = replace(PAPER, model_id=model.model_id, refinement=mode)
    return found


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--models", type=Path, help="folder of further models")
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), help="only these")
    parser.add_argument("--only-models", action="store_true", help="leave the other rows as they are")
    parser.add_argument("--only-outside", action="store_true", help="only refinement outside the loop")
    args = parser.parse_args(arguments)
    results = known_results("paper_ablations")
    for name in args.scenes:
        scene = named_scene(name)
        if not has_asset(scene.asset):
            continue
        asset = find_asset(scene.asset)
        frames = list(islice(scene.frames(asset), LONG_FRAMES))
        rows = results.setdefault(name, {})
        settings = {} if args.only_models else SETTINGS
        if args.only_outside:
            _outside(name, frames[:NUM_FRAMES], rows)
            path = write_result("paper_ablations", {"frames": NUM_FRAMES, "qp": QP, "views": FEW}, results)
            continue
        rows.update(_rows(name, frames[:NUM_FRAMES], settings | _models(args.models)))
        if not args.only_models:
            _outside(name, frames[:NUM_FRAMES], rows)
            rows.update(_rows(name, frames, LONG))
        without = _without(args.models)
        if without and scene.num_gaussians is not None:
            small = replace(scene, num_gaussians=SMALL).frames(asset)
            rows.update(_rows(name, list(islice(small, NUM_FRAMES)), without))
        path = write_result("paper_ablations", {"frames": NUM_FRAMES, "qp": QP, "views": FEW}, results)
    print(path)


if __name__ == "__main__":
    main()
