"""`python -m training.paper prepare | train | export | report`: see --help."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from dfcgs_codec.errors import InputError
from training.paper.config import STAGES, Config
from training.paper.data import Data
from training.paper.nets import ABLATIONS, PARTS
from training.paper.prepare import Layout, prepare
from training.paper.train import CHECKPOINT, Run, check_ablations, config_of_minutes, train

DATA = Path("out/paper/data")
#: shares of the time of a whole run, and of a fine-tune
WHOLE = {"warm_up": 0.05, "geometry": 0.7, "rendering": 0.25}
FINE_TUNE = {"geometry": 0.7, "rendering": 0.3}


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m training.paper", description="Train the model of profile `paper`."
    )
    parser.add_argument("--data", type=Path, default=DATA, help=f"prepared GoFs, default {DATA}")
    parser.add_argument("--threads", type=int, default=1, help="of torch, default 1")
    commands = parser.add_subparsers(dest="command", required=True)
    prepare = commands.add_parser("prepare", help="make GoFs of the training scenes")
    prepare.add_argument("--gaussians", type=int, default=Layout.max_gaussians, help="of a GoF, at most")
    prepare.add_argument("--control-spacing", type=int, default=Layout.control_spacing, help="M")
    prepare.add_argument("--neighbours", type=int, default=Layout.num_neighbours, help="K")
    _add_train(commands.add_parser("train", help="train, or go on; prepares what is missing"))
    export = commands.add_parser("export", help="write the integer model of a run")
    export.add_argument("run", type=Path)
    export.add_argument("--model-id", required=True)
    export.add_argument("--out", type=Path, required=True, help="folder of the two files")
    export.add_argument("--weight-bits", type=int, default=16)
    export.add_argument("--activation-bits", type=int, default=16)
    export.add_argument("--part", choices=PARTS, default="all", help="networks that have so few bits")
    report = commands.add_parser("report", help="figures by sequence, float and integer, as JSON")
    report.add_argument("run", type=Path)
    report.add_argument("--model", type=Path, help="NAME.weights of the exported model")
    report.add_argument("--pictures", action="store_true", help="PSNR of sequences held back, too")
    return parser


def _add_train(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, required=True, help="folder of checkpoint and curves")
    command.add_argument("--seed", type=int, default=1)
    command.add_argument("--minutes", type=float, help="choose iterations to take about so long")
    command.add_argument(
        "--iterations", type=int, nargs=3, metavar=("WARM_UP", "GEOMETRY", "RENDERING"), help="of each stage"
    )
    command.add_argument("--rate-weight", type=float, default=Config.rate_weight)
    command.add_argument("--resume", action="store_true", help="go on from the checkpoint in --out")
    command.add_argument("--from", dest="start", type=Path, help="fine-tune the networks of this checkpoint")
    command.add_argument("--without", action="append", default=[], metavar="PART", help=", ".join(ABLATIONS))


def _begin(args: argparse.Namespace, data: Data) -> Run:
    checkpoint = args.out / CHECKPOINT
    if args.resume:
        return Run.load(checkpoint)
    if checkpoint.exists():
        raise InputError(f"{checkpoint} is there already; --resume goes on from it")
    without = check_ablations(args.without)
    config = Config(seed=args.seed, rate_weight=args.rate_weight, without=without)
    if args.iterations is not None:
        config = replace(config, **dict(zip(STAGES, args.iterations, strict=True)))
    if args.start is not None:
        config = replace(config, warm_up=0)
    if args.minutes is not None:
        shares = WHOLE if args.start is None else FINE_TUNE
        config = config_of_minutes(config, data, args.minutes, shares)
    return Run.new(config) if args.start is None else Run.fine_tune(args.start, config)


def _train(args: argparse.Namespace) -> None:
    for _ in prepare(args.data):
        pass
    data = Data(args.data)
    run = _begin(args, data)
    args.out.mkdir(parents=True, exist_ok=True)
    print(json.dumps(run.config.as_dict()), file=sys.stderr, flush=True)
    train(run, data, args.out, lambda row: print(json.dumps(row), file=sys.stderr, flush=True))


def _export(args: argparse.Namespace) -> None:
    from training.paper.export import export_run

    path = export_run(
        Run.load(args.run / CHECKPOINT),
        Data(args.data),
        args.out / args.model_id,
        (args.weight_bits, args.activation_bits),
        args.part,
    )
    print(f"{path}: {path.stat().st_size} bytes", file=sys.stderr)


def _report(args: argparse.Namespace) -> None:
    from training.paper.report import report_run

    found = report_run(Run.load(args.run / CHECKPOINT), args.data, args.model, pictures=args.pictures)
    print(json.dumps(found, indent=1))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when done, 1 for bad input."""
    args = build_parser().parse_args(arguments)
    torch.set_num_threads(args.threads)
    try:
        if args.command == "prepare":
            layout = Layout(args.gaussians, args.control_spacing, args.neighbours)
            for path in prepare(args.data, layout=layout):
                print(path, file=sys.stderr)
        else:
            {"train": _train, "export": _export, "report": _report}[args.command](args)
    except (InputError, FileNotFoundError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
