"""What the frozen prior is worth.

    python -m evaluation.experiments.prior [--scenes NAME ...] [--streams] [--seconds] [--models FOLDER]

Every stream of a P-frame that may take the prior is coded in both ways, the same symbols, and bytes are
compared: motion (control points) and residual. Whole P-frames, coded with the prior and without, are rendered
and compared at equal PSNR. FOLDER holds other models (`<name>.npz`: widths, groups of inputs left out): their
bytes for some scenes at QP 28. Figures land in `evaluation/results/prior.json` after every scene.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Arguments
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any
from unittest import mock

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, encode_sequence
from dfcgs_codec.codec.symbols import SymbolCoder, T
from dfcgs_codec.encoder.frame_coding import CodedFrame
from dfcgs_codec.encoder.inter_coding import InterCoder, InterTask
from dfcgs_codec.encoder.motion_choice import MotionHint, MotionTrial
from dfcgs_codec.encoder.prior_choice import PriorChoice, PriorMode
from dfcgs_codec.encoder.symbol_writer import SymbolWriter
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.registry import DEFAULT_PRIOR, load_model, register
from evaluation.bd import bd_delta
from evaluation.experiments.paper.profile import Images, measure
from evaluation.speed import character, decode_times
from lab.assets import find_asset, present
from lab.quality import image
from lab.record import known_results, write_result
from lab.render import Camera
from lab.scenes.catalogue import group
from lab.scenes.catalogue import scene as named_scene
from lab.views import FEW, cameras

NUM_FRAMES = 10
QPS = (18, 28, 34)
MEDIUM = 28
#: what models are compared on
ABLATED = ("knight_walk", "mage_fitted", "playbot_sway_drift", "plant_sway")
#: models whose time to decode is told
_TIMED = ("main-1", "width-8", "width-32")
#: no P-frames, or those of another scene again
_LEFT_OUT = ("plant_bend_untracked", "playbot_twist_permuted")

Figures = dict[str, Any]


@contextmanager
def both_ways() -> Iterator[Counter[str]]:
    """Every stream is coded in both ways; counts bytes of what P-frames are made of, by part and way."""
    chosen: Counter[str] = Counter()
    found: Counter[str] = Counter()
    trials_of_frame: list[tuple[CodedFrame, Counter[str]]] = []
    coded_once, code = InterCoder._coded, InterCoder.code

    def coded(self: InterCoder, task: InterTask, trial: MotionTrial | None) -> CodedFrame:
        found.clear()
        frame = coded_once(self, task, trial)
        trials_of_frame.append((frame, Counter(found)))
        return frame

    def best_of_frame(self: InterCoder, task: InterTask) -> tuple[CodedFrame, MotionHint | None]:
        trials_of_frame.clear()
        frame, hint = code(self, task)
        chosen.update(next(counted for trial, counted in trials_of_frame if trial is frame))
        return frame, hint

    def either(self: SymbolWriter, walk: Callable[[SymbolCoder, bool], T]) -> T:
        ways = (True, False) if self.preferred is None else (self.preferred,)
        trials = []
        for with_prior in ways:
            trial = SymbolWriter()
            trial.choice(2, lambda chosen=with_prior: int(chosen))  # type: ignore[misc]
            trials.append((trial, walk(trial, with_prior), with_prior))
        if len(trials) == len((True, False)):
            part = "motion" if walk.__module__.endswith(".motion") else "residual"
            for trial, _, with_prior in trials:
                found[f"{part} {'prior' if with_prior else 'plain'}"] += len(trial.getvalue())
            found[f"{part} least"] += min(len(trial.getvalue()) for trial, *_ in trials)
        best, result, self.preferred = min(trials, key=lambda one: len(one[0].getvalue()))
        self._encoder = best._encoder
        return result

    with (
        mock.patch.object(SymbolWriter, "either", either),
        mock.patch.object(PriorChoice, "preferred", return_value=None),
        mock.patch.object(InterCoder, "_coded", coded),
        mock.patch.object(InterCoder, "code", best_of_frame),
    ):
        yield chosen


def stream_bytes(frames: list[GaussianCloud], qp: float, model_id: str | None, folder: Path) -> Figures:
    """Bytes of all streams in both ways."""
    options = EncoderOptions(qp=qp, gof_size=len(frames), tuning=EncoderTuning(model_id=model_id))
    with both_ways() as found:
        encode_sequence(frames, folder / "both.dgs", options, force=True)
    return dict(sorted(found.items()))


def _whole(frames: list[GaussianCloud], images: Images, views: list[Camera], folder: Path) -> Figures:
    """P-frames with the prior and without, at each QP, and bytes at equal PSNR in percent."""
    rows: dict[str, list[Figures]] = {}
    for mode in (PriorMode.PLAIN, PriorMode.AUTO, PriorMode.NETWORK):
        for qp in QPS:
            options = EncoderOptions(qp=qp, gof_size=len(frames), tuning=EncoderTuning(prior=mode))
            row = measure(frames, images, views, options, folder)
            row.pop("psnr_by_frame")
            rows.setdefault(mode.value, []).append(row | {"qp": qp})
    found: Figures = {"points": rows}
    for name in ("bytes_p", "bytes"):
        curves = [[(row[name], row["psnr"]) for row in rows[mode]] for mode in ("plain", "auto")]
        delta = bd_delta(*curves)
        found[f"bd_rate_{name}"] = None if delta is None else round(delta.bd_rate, 2)
    return found


def _scene(name: str, known: Figures | None) -> Figures:
    """The figures of a scene; with `known` ones only those of its streams anew."""
    scene = named_scene(name)
    frames = list(islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
    with tempfile.TemporaryDirectory() as folder:
        streams = {str(qp): stream_bytes(frames, qp, None, Path(folder)) for qp in QPS}
        if known is not None:
            return known | {"streams": streams}
        views = cameras(name, FEW)
        images = [[image(cloud, view) for view in views] for cloud in frames[1:]]
        return {"streams": streams} | _whole(frames, images, views, Path(folder))


def _registered(folder: Path) -> list[Path]:
    """The models of a folder, each known by its file's name."""
    paths = sorted(folder.glob("*.npz"))
    for path in paths:
        model = load_model(path)
        assert isinstance(model, ContextModel)
        register(replace(model, model_id=path.stem))
    return paths


def _models(paths: list[Path], results: Figures) -> None:
    """Bytes at QP 28 with each of some models."""
    for scene in present(map(named_scene, ABLATED)):
        name = scene.name
        frames = list(islice(scene.frames(find_asset(scene.asset)), NUM_FRAMES))
        known = results.setdefault("models", {}).setdefault(name, {})
        with tempfile.TemporaryDirectory() as target:
            for path in paths:
                known[path.stem] = stream_bytes(frames, MEDIUM, path.stem, Path(target))
                print(name, path.stem, known[path.stem], flush=True)


def _seconds(models: list[Path]) -> dict[str, float]:
    """Median seconds to decode P-frames of 200 000 Gaussians: plain, with the own prior or `models`."""
    frames = character(5)
    with tempfile.TemporaryDirectory() as target:
        files = {}
        for name in ["plain", *([path.stem for path in models] or [DEFAULT_PRIOR])]:
            mode = PriorMode.PLAIN if name == "plain" else PriorMode.NETWORK
            model_id = name if models and mode == PriorMode.NETWORK else None
            options = EncoderOptions(
                qp=28, gof_size=len(frames), tuning=EncoderTuning(prior=mode, model_id=model_id)
            )
            files[name] = Path(target) / f"{name}.dgs"
            encode_sequence(frames, files[name], options)
        # in turn, so that all of them meet the same machine
        times: dict[str, list[float]] = {name: [] for name in files}
        for _ in range(5):
            for name, file in files.items():
                times[name] += decode_times(file)[2:]
    medians = {name: round(statistics.median(found), 4) for name, found in times.items()}
    print(medians, flush=True)
    return medians


def main(arguments: Arguments[str] | None = None) -> None:
    """Run and write the result after every scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=[], help="only these")
    parser.add_argument("--streams", action="store_true", help="streams only; the rest stays as it was")
    parser.add_argument("--seconds", action="store_true", help="seconds to decode only")
    parser.add_argument("--models", type=Path, help="folder of further models")
    args = parser.parse_args(arguments)
    results = known_results("prior")
    conditions = {"frames": NUM_FRAMES, "qps": QPS, "views": FEW}
    rated = [] if args.seconds else [scene for scene in group("evaluation") if scene.name not in _LEFT_OUT]
    for scene in present(rated, args.scenes):
        scenes = results.setdefault("scenes", {})
        known = scenes.get(scene.name) if args.streams else None
        scenes[scene.name] = found = _scene(scene.name, known)
        print(scene.name, found["streams"][str(MEDIUM)], found["bd_rate_bytes_p"], flush=True)
        write_result("prior", conditions, results)
    if args.models is not None:
        paths = _registered(args.models)
        if not args.seconds:
            _models(paths, results)
        results["decode_p_s_by_width"] = _seconds([path for path in paths if path.stem in _TIMED])
    elif args.seconds or not args.streams:
        results["decode_p_s"] = _seconds([])
    print(write_result("prior", conditions, results))


if __name__ == "__main__":
    main()
