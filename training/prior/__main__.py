"""`python -m training.prior record | train`: see --help."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.weights_file import read_arrays
from training.prior.recordings import RECORDED, record
from training.prior.sequences import takes
from training.prior.untrained import untrained_arrays

RECORDINGS = Path("out/prior/recordings")


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m training.prior", description="Train the frozen prior of profile `main`."
    )
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help=f"default {RECORDINGS}")
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="record the codec on the training scenes; goes on")
    recording.add_argument("--takes", type=int, help="only the first so many (default all)")
    recording.add_argument("--model", type=Path, help="NAME.weights that streams are coded with meanwhile")
    training = commands.add_parser("train", help="networks and tables from the recordings")
    training.add_argument("--out", type=Path, required=True, help="NAME.weights and NAME.json")
    training.add_argument("--steps", type=int, default=6000, help="of each network")
    training.add_argument("--width", type=int, default=8, help="of both hidden layers")
    training.add_argument("--seed", type=int, default=1)
    training.add_argument("--without", nargs="*", default=[], help="groups of inputs that are not looked at")
    training.add_argument("--without-kinds", action="store_true", help="tables by class alone")
    training.add_argument("--threads", type=int, default=1, help="of torch")
    return parser


def _record(folder: Path, start: Path | None, num_takes: int | None) -> None:
    arrays = untrained_arrays() if start is None else read_arrays(start)
    model = ContextModel.of_arrays(RECORDED, arrays)
    for index, take in enumerate(islice(takes(), num_takes)):
        path = folder / f"{take.name}.{take.qp:g}.npz"
        if path.exists():
            continue
        begin = time.perf_counter()
        partial = path.with_suffix(".part.npz")
        record(take.frames, take.qp, model, seed=index).save(partial)
        partial.rename(path)
        print(f"{path.name}: {time.perf_counter() - begin:.0f} s", flush=True)


def _train(args: argparse.Namespace) -> None:
    # torch is needed from here on
    import torch

    from training.prior.ablations import masked
    from training.prior.export import write_model
    from training.prior.train import PARTS, Config, train

    torch.set_num_threads(args.threads)
    width = (args.width, args.width)
    config = Config(
        args.steps,
        seed=args.seed,
        hidden=dict.fromkeys(PARTS, width),
        masked=masked(args.without),
        kinds=not args.without_kinds,
    )
    lines: list[str] = []

    def log(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    arrays = train(args.recordings, config, log)
    about = {
        "training": {
            "recordings": sorted(path.stem for path in args.recordings.glob("*.npz")),
            "steps": args.steps,
            "width": args.width,
            "seed": args.seed,
            "without": args.without,
            "log": lines,
            "torch": torch.__version__,
        }
    }
    path = write_model(arrays, args.out, about)
    ContextModel.of_arrays(args.out.name, arrays)
    print(path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command."""
    args = build_parser().parse_args(arguments)
    if args.command == "record":
        _record(args.recordings, args.model, args.takes)
    else:
        _train(args)


if __name__ == "__main__":
    main()
