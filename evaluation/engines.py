"""How long the two engines decode, in turns in one run: `python -m evaluation.engines [FOLDER [NAME ...]]`.

Files of FOLDER, `NAME.dgs`, are taken where they are there, others encoded into it.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, GaussianCloud, encode_sequence, probe
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.core.engine import ENGINES
from dfcgs_codec.ply import read_ply
from evaluation.speed import QP, character, noise_frames
from lab.assets import find_asset
from lab.record import known_results, write_result
from lab.scenes import VARIANTS, SceneOptions, trained_sequence

_FRAMES = 6
_REPEATS = 3


def _sequence(name: str) -> list[GaussianCloud]:
    if name == "character_200k":
        return character(_FRAMES)
    cloud, _ = read_ply(find_asset("playbot_125k_sh2.ply", "playbot_31k_sh2.ply"))
    if name == "all_attributes_noise":
        return list(islice(noise_frames(cloud), _FRAMES))
    variant = {"tracked": "noisy", "all_attributes_drift": "drift"}[name]
    return list(VARIANTS[variant](trained_sequence(cloud, SceneOptions(_FRAMES), "sway"), 0))


NAMES = ("tracked", "all_attributes_drift", "all_attributes_noise", "character_200k")


def _seconds(path: Path, engine: str) -> Iterator[float]:
    """Of the processor, to arrays, hash checked, of each frame."""
    with path.open("rb") as file:
        # what is loaded once a process is no frame's
        decoder = SequenceDecoder(file, engine=engine)
        moments = [time.process_time()]
        for frame in decoder.frames():
            frame.cloud()
            moments.append(time.process_time())
    yield from (after - before for before, after in pairwise(moments))


def measure(path: Path) -> dict[str, Any]:
    """Median seconds of I-frames, of the first P-frame, which binds control points, and of the others."""
    info = probe(path)
    found: dict[str, Any] = {
        "num_gaussians": info.frames[0].num_gaussians,
        "sh_degree": info.header.sh_degree,
    }
    runs = [{engine: list(_seconds(path, engine)) for engine in ENGINES} for _ in range(_REPEATS)]
    for engine in ENGINES:
        times = [run[engine] for run in runs]
        found[engine] = {
            "decode_i_s": statistics.median(run[0] for run in times),
            "decode_first_p_s": statistics.median(run[1] for run in times),
            "decode_p_s": statistics.median(t for run in times for t in run[2:]),
        }
    core, numpy = (found[engine] for engine in ENGINES)
    found["times_faster"] = {key: numpy[key] / core[key] for key in core}
    return found


def main() -> None:
    """Measure and write the result, sequence after sequence."""
    conditions = {"qp": QP, "repeats": _REPEATS, "to": "arrays, hash checked", "seconds": "of the processor"}
    results = known_results("core")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(made)
        for name in sys.argv[2:] or NAMES:
            path = folder / f"{name}.dgs"
            if not path.exists():
                encode_sequence(_sequence(name), path, EncoderOptions(qp=QP, gof_size=_FRAMES))
            results[name] = measure(path)
            print(name, {key: round(value, 2) for key, value in results[name]["times_faster"].items()})
            write_result("core", conditions, results)


if __name__ == "__main__":
    main()
