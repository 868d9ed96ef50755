"""What other models of the frozen prior are worth: wider, narrower, without some of their inputs.

    python -m evaluation.experiments.prior FOLDER [--seconds]

FOLDER holds the models (`<name>.weights`). Bytes of motion and residual for some scenes at QP 28, and seconds
to decode, land in `evaluation/results/prior.json`.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Sequence as Arguments
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, encode_sequence, probe
from dfcgs_codec.bitstream.constants import ChunkType
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.registry import load_model, register
from evaluation.speed import character, decode_times
from lab.assets import find_asset, present
from lab.record import known_results, write_result
from lab.scenes.catalogue import scene as named_scene

NUM_FRAMES = 10
MEDIUM = 28
#: what models are compared on
ABLATED = ("knight_walk", "mage_fitted", "playbot_sway_drift", "plant_sway")
#: models whose time to decode is told
_TIMED = ("main-1", "width-8", "width-32")

Figures = dict[str, Any]


def stream_bytes(frames: list[GaussianCloud], model_id: str, folder: Path) -> Figures:
    """Bytes of P-frames' motion and residual."""
    path = folder / "coded.dgs"
    options = EncoderOptions(qp=MEDIUM, gof_size=len(frames), tuning=EncoderTuning(model_id=model_id))
    encode_sequence(frames, path, options, force=True)
    chunks = probe(path).chunk_bytes
    kinds = {"motion prior": ChunkType.MOTION, "residual prior": ChunkType.RESIDUAL}
    return {name: chunks[kind.name] for name, kind in kinds.items()}


def _registered(folder: Path) -> list[Path]:
    """The models of a folder, each known by its file's name."""
    paths = sorted(folder.glob("*.weights"))
    for path in paths:
        model = load_model(path)
        assert isinstance(model, ContextModel)
        register(replace(model, model_id=path.stem))
    return paths


def _models(paths: list[Path], results: Figures) -> None:
    """Bytes with each of some models."""
    for scene in present(map(named_scene, ABLATED)):
        name = scene.name
        frames = list(islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
        known = results.setdefault("models", {}).setdefault(name, {})
        with tempfile.TemporaryDirectory() as target:
            for path in paths:
                known[path.stem] = stream_bytes(frames, path.stem, Path(target))
                print(name, path.stem, known[path.stem], flush=True)


def _seconds(models: list[Path]) -> dict[str, float]:
    """Median seconds to decode P-frames of 200 000 Gaussians."""
    frames = character(5)
    with tempfile.TemporaryDirectory() as target:
        files = {path.stem: Path(target) / f"{path.stem}.dgs" for path in models}
        for name, file in files.items():
            options = EncoderOptions(qp=MEDIUM, gof_size=len(frames), tuning=EncoderTuning(model_id=name))
            encode_sequence(frames, file, options)
        # in turn, so that all of them meet the same machine
        times: dict[str, list[float]] = {name: [] for name in files}
        for _ in range(5):
            for name, file in files.items():
                times[name] += decode_times(file)[2:]
    medians = {name: round(statistics.median(found), 4) for name, found in times.items()}
    print(medians, flush=True)
    return medians


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("models", type=Path, help="folder of models")
    parser.add_argument("--seconds", action="store_true", help="seconds to decode only")
    args = parser.parse_args(arguments)
    results = known_results("prior")
    paths = _registered(args.models)
    if not args.seconds:
        _models(paths, results)
    results["decode_p_s_by_width"] = _seconds([path for path in paths if path.stem in _TIMED])
    conditions = {"frames": NUM_FRAMES, "qp": MEDIUM}
    print(write_result("prior", conditions, results))


if __name__ == "__main__":
    main()
