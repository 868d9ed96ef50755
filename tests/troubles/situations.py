"""What the tables of situations share: small frames as numpy columns, and a command line in this process."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.cli import main

Columns = Mapping[str, AnyArray]
_TYPE_NAMES = {"f4": "float", "f8": "double", "u1": "uchar", "u4": "uint", "i4": "int"}
_NUM_REST = (0, 9, 24, 45)


def ball(n: int = 200, sh_degree: int = 0, seed: int = 0, radius: float = 1.0) -> dict[str, npt.NDArray]:
    """Discs on a sphere that face outwards, with smooth colours: float32 columns in the usual order."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(n, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    turn = np.concatenate([1 + v[:, 2:], np.cross([0.0, 0.0, 1.0], v)], axis=1) + 1e-6
    size = 1.5 * radius / np.sqrt(max(n, 1))
    columns = {name: radius * v[:, i] for i, name in enumerate("xyz")}
    columns |= {name: np.zeros(n) for name in ("nx", "ny", "nz")}
    columns |= {f"f_dc_{i}": np.sin(5 * v[:, i] + i) for i in range(3)}
    columns |= {f"f_rest_{i}": rng.normal(0, 0.05, n) for i in range(_NUM_REST[sh_degree])}
    columns |= {"opacity": rng.normal(2, 1, n)}
    columns |= {f"scale_{i}": np.log(size * (1, 1, 0.1)[i]) + rng.normal(0, 0.2, n) for i in range(3)}
    columns |= {f"rot_{i}": turn[:, i] for i in range(4)}
    return {name: values.astype("f4") for name, values in columns.items()}


def moved(columns: Columns, shift: float) -> dict[str, npt.NDArray]:
    """The frame with half of its Gaussians (x > 0) shifted along z."""
    z = columns["z"] + np.float32(shift) * (columns["x"] > 0)
    return {**columns, "z": z.astype(columns["z"].dtype)}


def write(
    path: Path,
    columns: Columns,
    *,
    comments: Sequence[bytes] = (),
    before: str = "",
    after: str = "",
    tail: bytes = b"",
    newline: bytes = b"\n",
) -> Path:
    """A binary little-endian PLY with the columns' types; `before`, `after`: headers of other elements."""
    path.parent.mkdir(parents=True, exist_ok=True)
    count = len(next(iter(columns.values())))
    kinds = {name: f"{values.dtype.kind}{values.dtype.itemsize}" for name, values in columns.items()}
    lines = [b"ply", b"format binary_little_endian 1.0", *comments]
    lines += [before.encode()] * bool(before) + [b"element vertex %d" % count]
    lines += [f"property {_TYPE_NAMES[kind]} {name}".encode() for name, kind in kinds.items()]
    lines += [after.encode()] * bool(after) + [b"end_header", b""]
    table = np.empty(count, [(name, "<" + kind) for name, kind in kinds.items()])
    for name, values in columns.items():
        table[name] = values
    path.write_bytes(newline.join(lines) + table.tobytes() + tail)
    return path


def sequence(folder: Path, count: int = 3, name: str = "frame_{:04d}.ply", n: int = 200) -> Path:
    """A folder of frames that move a little."""
    for t in range(count):
        write(folder / name.format(t), moved(ball(n), 0.02 * t))
    return folder


class Outcome(NamedTuple):
    """What a command did."""

    code: int
    out: str
    err: str


def run(*arguments: str | Path) -> Outcome:
    """`dfcgs` with these arguments, in this process: as quick as the work itself."""
    out, err = io.StringIO(), io.StringIO()
    before, sys.argv = sys.argv, ["dfcgs", *map(str, arguments)]
    code = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    finally:
        sys.argv = before
    return Outcome(code, out.getvalue(), err.getvalue())


def encode(frames: Path, target: Path, *options: str) -> Outcome:
    """`dfcgs encode` in one process; unless a quality is asked for, none is searched for."""
    qp = () if {"--quality", "--psnr", "--qp"} & set(options) else ("--qp", "27")
    return run("encode", frames, target, "--jobs", "1", *qp, *options)
