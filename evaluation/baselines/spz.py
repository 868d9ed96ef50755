"""SPZ version 4 (Niantic's splat format) as a baseline.

Both directions run in the Niantic reference library, which the package `REQUIREMENT` links statically. Its
version 4 files were found byte-identical to those of the reference library's own WebAssembly build, and its
decoded values equal, up to float32 rounding, to those of an independent reader.

What one Gaussian costs before zstd (level 12, one stream per attribute): 9 bytes position, 1 alpha, 3 f_dc,
3 scale, 4 rotation, 3 K SH. The quantisers, all fixed by the format's defaults and not tunable here:

    positions  (N, 3)     scene units; multiples of POSITION_STEP. Values outside +-POSITION_LIMIT would wrap
                          around silently, so `encode_ply` refuses them
    scales     (N, 3)     natural log; multiples of LOG_SCALE_STEP, clamped to LOG_SCALE_RANGE
    opacities  (N,)       logit, stored as 8 bits uniform in alpha; bytes 0 and 255 are read as the ends of
                          ALPHA_RANGE, so every logit comes back within OPACITY_LOGIT_RANGE
    sh_dc      (N, 3)     8 bits over SH_DC_RANGE; clamped
    sh_rest    (N, 3, K)  multiples of SH_STEP[degree] and the upper end of SH_REST_RANGE; clamped
    rotations  (N, 4)     normalised, smallest three components; each a sign and 9 bits of magnitude over
                          0 .. sqrt(1/2), the largest one rebuilt from unit length. q and -q are the same

SPZ names RUB its axis system and 3DGS PLY files usually are RDF. The package flips neither on writing nor on
reading, so axes, rotations and SH signs come back as they were in the PLY; no flip is to be undone. Order and
number of the Gaussians are kept.

Quirks of the package that this module works around: its `read` fails on SH degree 0, so files are converted
to PLY in memory; like the released reference readers it gives an infinite logit for alpha bytes 0 and 255,
made finite here without a visible change of alpha (some readers take bytes 1 and 254 instead, which would
make erased Gaussians visible). One remains: each decoding prints a line "[SPZ] loadSpzPacked ..." to the
standard output of the process.
"""

from __future__ import annotations

import gzip
import importlib
import math
import struct
import zlib
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Float32
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS, GaussianCloud

#: the pinned writer and reader; a wheel without dependencies
REQUIREMENT = "gaussforge==0.6.0"

#: the version that `encode_ply` writes
SPZ_VERSION = 4

#: positions: 24-bit two's complement with 12 fractional bits, scene units
POSITION_STEP = 2.0**-12
POSITION_LIMIT = 2048.0

#: natural logarithm of the standard deviation: byte / 16 - 10
LOG_SCALE_STEP = 1.0 / 16.0
LOG_SCALE_RANGE = (-10.0, 255.0 / 16.0 - 10.0)

#: alpha: stored as round(255 alpha); ALPHA_RANGE stands in for 0 and 1, whose logits are infinite
ALPHA_STEP = 1.0 / 255.0
ALPHA_RANGE = (1e-6, 1.0 - 1e-6)
OPACITY_LOGIT_RANGE = (-math.log(1e6 - 1.0), math.log(1e6 - 1.0))

#: SH degree 0 coefficient: (byte / 255 - 0.5) / 0.15
SH_DC_STEP = 1.0 / (0.15 * 255.0)
SH_DC_RANGE = (-0.5 / 0.15, 0.5 / 0.15)

#: higher SH coefficients: (byte - 128) / 128 with 5 bits for degree 1 and 4 bits for degrees 2 and 3
SH_STEP = {1: 1.0 / 16.0, 2: 1.0 / 8.0, 3: 1.0 / 8.0}
SH_REST_RANGE = (-1.0, 127.0 / 128.0)

#: one of the three stored quaternion components
ROTATION_STEP = math.sqrt(0.5) / 511.0

#: magic, little-endian u32 version, u32 number of Gaussians: common to all versions
_PREFIX = struct.Struct("<4sII")
_MAGIC = b"NGSP"
_GZIP_MAGIC = b"\x1f\x8b"
_PLY_HEADER_END = b"end_header\n"


class BaselineError(RuntimeError):
    """The baseline could not write or read a file."""


class BaselineUnavailable(BaselineError):
    """The pinned package of the baseline is not installed."""


def encode_ply(ply_path: Path, spz_path: Path) -> None:
    """Write the uncompressed binary 3DGS PLY `ply_path`, of finite values, as SPZ version 4 to `spz_path`."""
    library, ply = _library(), ply_path.read_bytes()
    _check_bounds(_checked(library.get_model_info(ply, "ply"), ply_path)["bounds"], ply_path)
    spz_path.write_bytes(_checked(library.convert(ply, "ply", "spz", spz_version=SPZ_VERSION), ply_path))
    written = version(spz_path)
    if written != SPZ_VERSION:
        raise BaselineError(f"{spz_path}: SPZ version {written}, expected {SPZ_VERSION}")


def decode(spz_path: Path) -> GaussianCloud:
    """The Gaussians of an SPZ file, in the axes of the PLY it was written from; rotations of unit length."""
    _, n = _prefix(spz_path)
    ply = _checked(_library().convert(spz_path.read_bytes(), "spz", "ply"), spz_path)
    if not ply:
        raise BaselineError(f"{spz_path}: damaged SPZ file")
    table = _ply_table(ply, n)
    k = (table.shape[1] - 17) // 3
    _, positions, _, sh_dc, sh_rest, opacities, scales, rotations = np.split(
        table, np.cumsum([0, 3, 3, 3, 3 * k, 1, 3]), axis=1
    )
    return GaussianCloud(
        positions=positions.copy(),
        rotations=rotations.copy(),
        scales=scales.copy(),
        opacities=np.clip(opacities[:, 0], *OPACITY_LOGIT_RANGE).astype(np.float32),
        sh_dc=sh_dc.copy(),
        sh_rest=sh_rest.reshape(n, 3, k).copy(),
    )


def version(spz_path: Path) -> int:
    """The version in the header of an SPZ file, 1 to 4; needs no package."""
    return _prefix(spz_path)[0]


def _prefix(spz_path: Path) -> tuple[int, int]:
    """Version and number of Gaussians; up to version 3 the header is inside the gzip stream."""
    with spz_path.open("rb") as file:
        head = file.read(_PREFIX.size)
    if head[:2] == _GZIP_MAGIC:
        head = _gzip_head(spz_path)
    if len(head) < _PREFIX.size or head[:4] != _MAGIC:
        raise BaselineError(f"{spz_path}: not an SPZ file")
    _, spz_version, count = _PREFIX.unpack(head)
    return int(spz_version), int(count)


def _gzip_head(spz_path: Path) -> bytes:
    """The first bytes of a gzip file's content; empty if it is damaged."""
    try:
        with gzip.open(spz_path, "rb") as file:
            return file.read(_PREFIX.size)
    except (OSError, EOFError, zlib.error):
        return b""


def _library() -> Any:
    """The reader and writer of the pinned package."""
    name, pinned = REQUIREMENT.split("==")
    try:
        module, installed = importlib.import_module(name), metadata.version(name)
    except (ImportError, metadata.PackageNotFoundError) as error:
        raise BaselineUnavailable(f"the SPZ baseline needs {REQUIREMENT}: {error}") from error
    if installed != pinned:
        raise BaselineUnavailable(f"the SPZ baseline needs {REQUIREMENT}, found {name} {installed}")
    return module.GaussForge()


def _checked(result: dict[str, Any], path: Path) -> Any:
    """The data of a result of the package, or its error."""
    if "error" in result:
        raise BaselineError(f"{path}: {result['error']}")
    return result["data"]


def _check_bounds(bounds: dict[str, tuple[float, float]], path: Path) -> None:
    """Refuse positions that the 24-bit integers of SPZ cannot hold; `bounds` in scene units, per axis."""
    limit = POSITION_LIMIT - POSITION_STEP
    for axis, (low, high) in bounds.items():
        if not -limit <= low <= high <= limit:
            raise BaselineError(f"{path}: {axis} spans {low} .. {high}, SPZ holds +-{POSITION_LIMIT}")


def _ply_table(ply: bytes, n: int) -> Float32:
    """The vertices (n, 17 + 3 K) of a PLY that the package wrote, in the order of `_ply_columns`."""
    header, _, body = ply.partition(_PLY_HEADER_END)
    lines = header.decode("ascii").splitlines()
    columns = [line.split()[-1] for line in lines if line.startswith("property float ")]
    if columns not in [_ply_columns(k) for k in SH_REST_COEFFICIENTS]:
        raise BaselineError(f"{REQUIREMENT} wrote PLY columns {columns}")
    if len(body) != 4 * n * len(columns):
        raise BaselineError(f"{REQUIREMENT} read {len(body)} bytes, expected {n} Gaussians")
    return np.frombuffer(body, dtype="<f4").astype(np.float32).reshape(n, len(columns))


def _ply_columns(k: int) -> list[str]:
    """Names of the columns for K = `k` higher SH coefficients per channel."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * k)]
    return [*names, "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
