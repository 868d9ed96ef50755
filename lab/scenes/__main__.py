"""Write a generated sequence as PLY files: `python -m lab.scenes SCENE OUT_DIR`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply, write_ply
from lab.scenes.animated import animated_sequence
from lab.scenes.options import SceneOptions
from lab.scenes.stress import STRESS, stress_sequence
from lab.scenes.trained import MOTIONS, trained_sequence
from lab.scenes.variants import VARIANTS

EXAMPLES = """examples:
  python -m lab.scenes assets/Fox.glb out/fox --clip Run --variant noisy
  python -m lab.scenes assets/playbot_31k_sh2.ply out/playbot --motion sway --frames 30
  python -m lab.scenes scene-cut out/cut --gaussians 2000 --sh-degree 0
"""


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.scenes",
        description="Generate a sequence of Gaussian frames: frame_0000.ply, frame_0001.ply, ...",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", help=f"a .glb, .gltf or .ply file, or a stress case: {', '.join(STRESS)}")
    parser.add_argument("out_dir", type=Path, help="folder for the frames; must not hold any yet")
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--gaussians", type=int, help="default 50000; for a .ply all it has, and no more")
    parser.add_argument("--sh-degree", type=int, choices=range(4), help="default 2; for a .ply what it has")
    parser.add_argument("--variant", choices=sorted(VARIANTS), default="smooth")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fps", type=float, default=30.0, help="frames per second of the asset's own time")
    parser.add_argument("--clip", default="0", help="name or number of the animation in a .glb or .gltf")
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="part", help="how a .ply moves")
    return parser


def scene_frames(scene: str, options: SceneOptions, *, clip: str, motion: str) -> Iterator[GaussianCloud]:
    """The clean frames of a scene named on the command line."""
    if scene in STRESS:
        return stress_sequence(scene, options)
    path = Path(scene)
    if not path.is_file():
        raise InputError(f"{scene}: neither a file nor one of {', '.join(STRESS)}")
    if path.suffix.lower() in (".glb", ".gltf"):
        return animated_sequence(path, options, clip)
    if path.suffix.lower() == ".ply":
        return trained_sequence(read_ply(path)[0], options, motion)
    raise InputError(f"{scene}: expected a .glb, .gltf or .ply file")


def write_frames(frames: Iterator[GaussianCloud], out_dir: Path) -> int:
    """Write all frames and return their number; refuses a folder that already holds some."""
    if next(out_dir.glob("frame_*.ply"), None) is not None:
        raise InputError(f"{out_dir} already holds frames; remove them or choose another folder")
    out_dir.mkdir(parents=True, exist_ok=True)
    count = 0
    for count, frame in enumerate(frames, start=1):
        write_ply(out_dir / f"frame_{count - 1:04d}.ply", frame)
    return count


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when done, 1 for bad input."""
    args = build_parser().parse_args(arguments)
    start = time.perf_counter()
    try:
        options = SceneOptions(args.frames, args.gaussians, args.sh_degree, args.seed, args.fps)
        clean = scene_frames(args.scene, options, clip=args.clip, motion=args.motion)
        count = write_frames(VARIANTS[args.variant](clean, args.seed), args.out_dir)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    seconds = time.perf_counter() - start
    print(f"{args.out_dir}: {count} frames in {seconds:.1f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
