"""Print the oldest version that `pyproject.toml` allows of every dependency, as constraints for pip.

python tools/oldest_versions.py > oldest.txt; pip install --constraint oldest.txt .
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

_PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
_FLOOR = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)(,.*)?")


def oldest(dependencies: list[str]) -> list[str]:
    """`name==floor` of each; ValueError for one without a floor, whose oldest version nobody can try."""
    pins = []
    for dependency in dependencies:
        match = _FLOOR.fullmatch(dependency.replace(" ", ""))
        if match is None:
            raise ValueError(f"{dependency!r} has no floor such as name>=1.2")
        pins.append(f"{match[1]}=={match[2]}")
    return pins


if __name__ == "__main__":
    print("\n".join(oldest(tomllib.loads(_PYPROJECT.read_text())["project"]["dependencies"])))
