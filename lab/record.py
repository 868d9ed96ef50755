"""Results as JSON: what was measured, of which state of the code, on which machine, how."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

SCHEMA = 1
REPOSITORY = Path(__file__).parent.parent
RESULTS = REPOSITORY / "evaluation" / "results"
_PACKAGES = (
    "numpy",
    "scipy",
    "constriction",
    "plyfile",
    "numba",
    "zstandard",
    "gaussforge",
    "splats4d",
    "fourdgs",
    "wasmtime",
    "bjontegaard",
)


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def results(name: str) -> dict[str, Any]:
    """The figures of a result; raises FileNotFoundError where it was never measured."""
    found: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text())["results"]
    return found


def has_results(name: str) -> bool:
    """Whether `results` would find it."""
    return (RESULTS / f"{name}.json").exists()


def known_results(name: str) -> dict[str, Any]:
    """What an earlier run left, empty where there was none: scenes that a run does not touch stay."""
    return results(name) if has_results(name) else {}


def write_result(name: str, conditions: dict[str, Any], results: Any) -> Path:
    """Write `evaluation/results/NAME.json` and return its path."""
    record = {
        "schema": SCHEMA,
        "name": name,
        "commit": _commit(),
        "machine": {"processor": _processor(), "cores": os.cpu_count(), "system": platform.system()},
        "versions": _versions(),
        "conditions": conditions,
        "results": results,
    }
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps(record, indent=1) + "\n")
    return path
