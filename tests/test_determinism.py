"""The same file decodes to the same bytes in any process, with any BLAS and any CPU features."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions, GaussianCloud, decode_sequence, encode_sequence
from dfcgs_codec.bitstream.constants import IntraKind, Profile
from dfcgs_codec.encoder.plan.tuning import RefinementMode
from dfcgs_codec.ply import write_ply
from lab.options import encoder_options
from lab.small_clouds import all_changing, drifting, make_cloud, real_cloud, swaying
from tests.helpers import QUICK, run_python

#: prints, of each file, a digest of every state and of every PLY that a fresh process decodes
_DECODE = """
import hashlib, sys, tempfile
from pathlib import Path
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.ply import write_ply
for name in sys.argv[1:]:
    with open(name, "rb") as file, tempfile.TemporaryDirectory() as folder:
        for frame in SequenceDecoder(file).frames():
            path = Path(folder) / "frame.ply"
            write_ply(path, frame.cloud())
            print(frame.state.hash().hex(), hashlib.sha256(path.read_bytes()).hexdigest())
"""


def _avx2_features() -> str:
    """What this numpy calls the level with AVX2 and all above it, as far as it dispatches to them."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    wanted = ("X86_V3", "X86_V4", "AVX2", "FMA3", "AVX512F", "AVX512_SKX", "AVX512_ICL", "AVX512_SPR")
    names = [name for name in __cpu_dispatch__ if name in wanted and __cpu_features__.get(name)]
    return " ".join(names)


def _sequences() -> dict[str, tuple[list[GaussianCloud], EncoderOptions]]:
    real = real_cloud(1500)
    return {
        "tracked": (drifting(real, 3), replace(QUICK, gof_size=2)),
        "all_attributes": (all_changing(make_cloud(400, 3), 3), EncoderOptions(qp=12)),
        "paper": (
            swaying(real, 3, 0.1),
            encoder_options(QUICK, profile=Profile.PAPER, refinement=RefinementMode.ON),
        ),
        "verbatim": (drifting(make_cloud(300, 1), 3), encoder_options(QUICK, intra=IntraKind.PLY)),
    }


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, list[str]]]:
    """Each stream, and its digests as this process finds them; the input frames are gone by then."""
    folder = tmp_path_factory.mktemp("streams")
    result = {}
    for name, (frames, options) in _sequences().items():
        originals = folder / f"{name}_frames"
        originals.mkdir()
        for index, cloud in enumerate(frames):
            write_ply(originals / f"frame_{index:04d}.ply", cloud)
        path = folder / f"{name}.dgs"
        encode_sequence(originals, path, options)
        shutil.rmtree(originals)
        digests = []
        for frame in decode_sequence(path):
            write_ply(folder / "frame.ply", frame.cloud())
            digest = hashlib.sha256((folder / "frame.ply").read_bytes()).hexdigest()
            digests.append(f"{frame.state.hash().hex()} {digest}")
        result[name] = (path, digests)
    return result


ENVIRONMENTS: dict[str, dict[str, str]] = {
    "one BLAS thread": {"OPENBLAS_NUM_THREADS": "1"},
    "two BLAS threads": {"OPENBLAS_NUM_THREADS": "2"},
    "an old BLAS kernel": {"OPENBLAS_CORETYPE": "Prescott"},
    "no AVX2": {"NPY_DISABLE_CPU_FEATURES": _avx2_features()},
    "other hash seed": {"PYTHONHASHSEED": "4711"},
}


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_decoding_does_not_depend_on(environment: str, streams: dict[str, tuple[Path, list[str]]]) -> None:
    done = run_python(
        "-c", _DECODE, *(str(path) for path, _ in streams.values()), **ENVIRONMENTS[environment]
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [line for _, digests in streams.values() for line in digests]


def test_disabled_features_are_really_off() -> None:
    names = _avx2_features()
    script = (
        "from numpy._core._multiarray_umath import __cpu_features__ as f; import sys;"
        f"sys.exit(any(f[n] for n in {names.split()!r}))"
    )
    done = run_python("-c", script, NPY_DISABLE_CPU_FEATURES=names)
    assert done.returncode == 0, done.stderr


def test_encoding_is_deterministic_too(tmp_path: Path) -> None:
    frames = drifting(real_cloud(800), 3)
    for name in ("a.dgs", "b.dgs"):
        encode_sequence(frames, tmp_path / name)
    assert (tmp_path / "a.dgs").read_bytes() == (tmp_path / "b.dgs").read_bytes()


def test_verify_runs_in_a_process_of_its_own(streams: dict[str, tuple[Path, list[str]]]) -> None:
    path, _ = streams["tracked"]
    done = subprocess.run(
        [sys.executable, "-m", "dfcgs_codec", "decode", str(path), "--check-only"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "3 frames, all hashes right" in done.stdout
