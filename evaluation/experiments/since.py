"""What the comparison has gained since another commit: `python -m evaluation.experiments.since COMMIT`.

BD-rate of each of our curves on each scene against the same curve in that commit's `bench.json`; where the
two commits share what they measured, it is 0.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np

from evaluation.bd import bd_delta
from evaluation.points import CODEC_CURVES
from lab.record import REPOSITORY, results, write_result

_FILE = "evaluation/results/bench.json"


def _pairs(scene: dict[str, Any], method: str) -> list[tuple[float, float]]:
    found = [p for p in scene["points"] if p["method"] == method and "psnr" in p]
    return [(p["bytes"], p["psnr"]) for p in found]


def gains(before: dict[str, Any], now: dict[str, Any]) -> dict[str, dict[str, float]]:
    """BD-rate in percent by method and scene; `mean` is that of the logarithms' mean."""
    table: dict[str, dict[str, float]] = {}
    for method in CODEC_CURVES:
        row = {}
        for scene in now.keys() & before.keys():
            old, new = _pairs(before[scene], method), _pairs(now[scene], method)
            delta = bd_delta(old, new) if old and new and old != new else None
            if delta is not None:
                row[scene] = round(delta.bd_rate, 2)
        if row:
            mean = np.mean(np.log1p(np.array(list(row.values())) / 100))
            table[method] = dict(sorted(row.items())) | {"mean": round(100 * float(np.expm1(mean)), 2)}
    return table


def main() -> None:
    """Print and write the table."""
    commit = sys.argv[1]
    command = ["git", "show", f"{commit}:{_FILE}"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True, text=True)
    found = gains(json.loads(done.stdout)["results"], results("bench"))
    for method, row in found.items():
        print(method, row)
    print(write_result("since", {"before": commit}, found))


if __name__ == "__main__":
    main()
