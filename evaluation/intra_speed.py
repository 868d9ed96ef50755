"""Seconds of one I-frame of 100 000 Gaussians, SH degree 3: `python -m evaluation.intra_speed`.

The first frame of `mage_spell`, one process, array to file and back, hash checked; medians, on an idle
machine.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from dfcgs_codec import EncoderOptions, EncoderTuning, GaussianCloud, decode_sequence, encode_sequence
from evaluation.assets import find_asset
from evaluation.record import write_result
from training.scenes.catalogue import scene

_SCENE = "mage_spell"
_REPEATS = 3
QP = 28
VARIANTS = {
    "graded": EncoderOptions(qp=QP),
    "uniform": EncoderOptions(qp=QP, tuning=EncoderTuning(visibility=False)),
}


def measure(cloud: GaussianCloud, options: EncoderOptions) -> dict[str, Any]:
    """Bytes and median seconds; the first run, which fills caches, does not count."""
    encode, decode = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.dgs"
        for _ in range(_REPEATS + 1):
            start = time.perf_counter()
            encode_sequence([cloud], path, options, force=True)
            middle = time.perf_counter()
            next(iter(decode_sequence(path))).cloud()
            encode.append(middle - start)
            decode.append(time.perf_counter() - middle)
        size = path.stat().st_size
    times = {"encode_s": statistics.median(encode[1:]), "decode_s": statistics.median(decode[1:])}
    return {"bytes": size, **{name: round(value, 3) for name, value in times.items()}}


def main() -> None:
    """Measure and write the result."""
    found = scene(_SCENE)
    cloud = next(iter(found.frames(find_asset(found.asset))))
    results = {name: measure(cloud, options) for name, options in VARIANTS.items()}
    for name, row in results.items():
        print(name, row)
    conditions = {
        "scene": _SCENE,
        "qp": QP,
        "num_gaussians": cloud.num_gaussians,
        "sh_degree": cloud.sh_degree,
        "repeats": _REPEATS,
    }
    print(write_result("intra_speed", conditions, results))


if __name__ == "__main__":
    main()
