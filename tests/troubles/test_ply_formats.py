"""Frames in other formats: read where a reader is installed, and said what they are where not.

The files are made by `foreign_formats`, which shares no code with the reader.
"""

from __future__ import annotations

import gzip
import re
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from dfcgs_codec.array_types import Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import InputPolicy, describe_foreign, peek_header, read_ply
from tests.helpers import alphas, turns
from tests.troubles import foreign_formats as foreign
from tests.troubles.situations import ball, encode, run, write

WRITERS: dict[str, tuple[str, Callable[[dict[str, npt.NDArray]], bytes]]] = {
    "splat": (".splat", foreign.splat),
    "SPZ 2": (".spz", foreign.spz),
    "SPZ 3": (".spz", lambda c: foreign.spz(c, 3)),
    "compressed": (".compressed.ply", foreign.compressed_ply),
    "compressed, early": (".compressed.ply", lambda c: foreign.compressed_ply(c, colour_bounds=False)),
}
FORMATS = [(name, degree) for name in WRITERS for degree in range(4) if name != "splat" or not degree]


def plain(tmp_path: Path, columns: dict[str, npt.NDArray]) -> GaussianCloud:
    return read_ply(write(tmp_path / "plain.ply", columns))[0]


def made(tmp_path: Path, name: str, columns: dict[str, npt.NDArray]) -> Path:
    suffix, writer = WRITERS[name]
    path = tmp_path / f"frame_0000{suffix}"
    path.write_bytes(writer(columns))
    return path


def turned(cloud: GaussianCloud) -> Float64:
    """Half a turn about x: from the axes of SPZ to those of PLYs."""
    return cloud.positions * [1.0, -1.0, -1.0]


def shades(cloud: GaussianCloud, direction: Float64) -> Float64:
    """The view-dependent part of the colours (N, 3), seen along `direction`, by the real SH of 3DGS."""
    x, y, z = direction
    xx, yy, zz = x * x, y * y, z * z
    basis = np.array(
        [
            *(-0.48860251 * y, 0.48860251 * z, -0.48860251 * x),
            *(1.09254843 * x * y, -1.09254843 * y * z, 0.31539157 * (2 * zz - xx - yy)),
            *(-1.09254843 * x * z, 0.54627422 * (xx - yy)),
            *(-0.59004359 * y * (3 * xx - yy), 2.89061144 * x * y * z, -0.45704580 * y * (4 * zz - xx - yy)),
            *(0.37317633 * z * (2 * zz - 3 * xx - 3 * yy), -0.45704580 * x * (4 * zz - xx - yy)),
            *(1.44530572 * z * (xx - yy), -0.59004359 * x * (xx - 3 * yy)),
        ]
    )
    return cloud.sh_rest @ basis[: cloud.sh_rest.shape[2]]


@pytest.mark.parametrize(("name", "degree"), FORMATS)
def test_values_are_those_that_an_independent_writer_wrote(tmp_path: Path, name: str, degree: int) -> None:
    columns = ball(300, degree)
    path, source = made(tmp_path, name, columns), plain(tmp_path, columns)
    header = peek_header(path)
    assert (header.num_gaussians, header.sh_degree) == (300, degree)
    cloud, notes = read_ply(path)
    assert notes == []
    spz = name.startswith("SPZ")
    assert np.allclose(cloud.positions, turned(source) if spz else source.positions, atol=2e-3)
    assert np.allclose(cloud.scales, source.scales, atol=0.04)
    assert np.allclose(alphas(cloud), alphas(source), atol=0.003)
    assert np.allclose(cloud.sh_dc, source.sh_dc, atol=0.02)
    half_turn = np.diag([1.0, -1.0, -1.0]) if spz else np.eye(3)
    axes = half_turn @ turns(source).as_matrix() * np.exp(source.scales)[:, None, :]
    found = turns(cloud).as_matrix() * np.exp(source.scales)[:, None, :]
    spread = np.abs(found @ found.transpose(0, 2, 1) - axes @ axes.transpose(0, 2, 1)).max(axis=(1, 2))
    assert (spread < 0.12 * np.exp(2 * source.scales.max(axis=1))).all()
    for direction in np.random.default_rng(0).normal(size=(3, 3)):
        direction /= np.linalg.norm(direction)
        if degree:
            assert np.allclose(
                shades(cloud, half_turn @ direction), shades(source, direction), atol=0.03 * (degree + 1)
            )


@pytest.mark.parametrize("name", WRITERS)
def test_frames_without_gaussians(tmp_path: Path, name: str) -> None:
    path = made(tmp_path, name, {key: values[:0] for key, values in ball(2).items()})
    assert peek_header(path).num_gaussians == 0
    assert read_ply(path)[0].num_gaussians == 0


@pytest.mark.parametrize("name", WRITERS)
def test_alpha_0_and_1_are_finite_opacities(tmp_path: Path, name: str) -> None:
    columns = ball(9)
    columns["opacity"][:2] = [60, -60]
    cloud, _ = read_ply(made(tmp_path, name, columns))
    assert np.isfinite(cloud.opacities).all()
    assert np.allclose(alphas(cloud)[:2], [1, 0], atol=0.0015)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("cut", [3, 17, 200])
def test_truncated_files_are_refused(tmp_path: Path, name: str, cut: int) -> None:
    path = made(tmp_path, name, ball(300))
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(InputError) as caught:
        read_ply(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_what_is_said_of_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.spz"
    path.write_bytes(foreign.spz(ball(5), flags=1))
    header = peek_header(path)
    assert header.comments == (b"SplatRenderMode: mip",)
    assert header.remarks == ("read from an SPZ file, turned about x (SPZ has y up, PLYs have y down)",)


def test_an_spz_that_announces_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.spz"
    path.write_bytes(struct.pack("<4sIIBBBB", b"NGSP", 4, 4_000_000_000, 0, 12, 0, 0) + bytes(100))
    with pytest.raises(InputError, match="4000000000 Gaussians in 116 bytes"):
        peek_header(path)
    bomb = foreign.spz(ball(5))
    path.write_bytes(gzip.compress(gzip.decompress(bomb)[:16] + bytes(10**7)))
    with pytest.raises(InputError, match="damaged or truncated"):
        read_ply(path)


def test_nothing_of_the_reader_reaches_standard_output(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    read_ply(made(tmp_path, "SPZ 2", ball(5)))
    assert capfd.readouterr() == ("", "")


def test_a_compressed_ply_of_noise_says_what_it_is(tmp_path: Path) -> None:
    path = made(tmp_path, "compressed", ball(300))
    data = path.read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    path.write_bytes(data[:body] + b"\xff" * (len(data) - body))
    with pytest.raises(
        InputError, match=r"a compressed PLY \(packed_position\): .*; export it as an unc.*--rep"
    ):
        read_ply(path)


def test_compressed_plys_that_are_not_as_known(tmp_path: Path) -> None:
    path = made(tmp_path, "compressed", ball(300, 1))
    data = path.read_bytes()
    for old, new, words in (
        (b"min_x", b"min_w", "other bounds"),
        (b"float max_y", b"int   max_y", "other bounds"),
        (b"packed_scale", b"packed_style", "other words"),
        (b"element chunk 2", b"element chunk 1", "in 1 chunks"),
        (b"element sh 300", b"element sh 299", "other words or SH"),
    ):
        path.write_bytes(data.replace(old, new))
        with pytest.raises(
            InputError, match=rf"a compressed PLY \(packed_position\) .*{words}.*; export it as"
        ):
            peek_header(path)


# --- without a reader ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WRITERS)
def test_without_a_reader_the_line_says_what_helps(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dfcgs_codec.ply.formats.find_spec", lambda _: None)
    path = made(tmp_path, name, ball(5))
    with pytest.raises(InputError) as caught:
        peek_header(path)
    message = str(caught.value)
    assert "pip install 'dfcgs-codec[formats]'" in message
    command = r"npx @playcanvas/splat-transform \S+ \S*frame_0000.ply' makes a plain PLY of it"
    assert re.search(f"'mkdir -p plain && {command}" if "compressed" in name else f"'{command}", message)


FOREIGN = {
    "a.ksplat": "splat-transform",
    "A.SOG": "splat-transform",
    "a b.spz": r"splat-transform '.*a b.spz' '.*a b.ply'",
    "a.npz": "numpy arrays",
    "a.pth": "PyTorch checkpoint",
    "a.dgs": "dfcgs decode",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_that_are_not_read_are_described(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"PK\x03\x04 anything")
    assert re.search(FOREIGN[name], describe_foreign(path) or "")
    with pytest.raises(InputError) as caught:
        peek_header(path)
    assert str(path) in str(caught.value)


def test_plys_are_not_foreign() -> None:
    assert describe_foreign(Path("frame_0000.ply")) is None


# --- from the command line ----------------------------------------------------------------------------


def test_compressed_plys_are_encoded(tmp_path: Path) -> None:
    for t in range(2):
        path = tmp_path / "in" / f"frame_{t:04d}.compressed.ply"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(foreign.compressed_ply(ball(200)))
    done = encode(tmp_path / "in", tmp_path / "a.dgs")
    assert done.code == 0
    assert "frame_0000.compressed.ply and 1 more: read from a compressed PLY" in done.err
    assert run("decode", tmp_path / "a.dgs", tmp_path / "out").code == 0
    found, _ = read_ply(tmp_path / "out" / "frame_0001.ply")
    assert found.num_gaussians == 200


@pytest.mark.parametrize("name", ["splat", "SPZ 3"])
def test_folders_and_named_files_without_plys(tmp_path: Path, name: str) -> None:
    suffix, writer = WRITERS[name]
    for t in range(2):
        path = tmp_path / "in" / f"frame_{t:04d}{suffix}"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(writer(ball(100)))
    (tmp_path / "in" / "other.ksplat").write_bytes(b"anything")
    done = encode(tmp_path / "in", tmp_path / "a.dgs")
    assert done.code == 0, done.err
    assert f"no PLY in the folder: 2 {suffix} files taken as frames" in done.err
    assert "1 file left out, as it is no PLY: other.ksplat" in done.err
    named = sorted((tmp_path / "in").glob(f"*{suffix}"))
    assert run("encode", *named, tmp_path / "b.dgs", "--jobs", "1", "--qp", "27").code == 0
    assert (tmp_path / "a.dgs").read_bytes() == (tmp_path / "b.dgs").read_bytes()


def test_folders_of_what_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.ksplat").write_bytes(b"anything")
    assert "a .ksplat file; 'npx @playcanvas" in encode(tmp_path / "in", tmp_path / "a.dgs").err
    monkeypatch.setattr("dfcgs_codec.ply.formats.find_spec", lambda _: None)
    (tmp_path / "in" / "a.ksplat").rename(tmp_path / "in" / "a.spz")
    outcome = encode(tmp_path / "in", tmp_path / "a.dgs")
    assert outcome.code == 1
    assert "pip install 'dfcgs-codec[formats]'" in outcome.err


def test_a_reader_that_dies_is_a_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path, "splat", ball(5))

    def died(*_: object, **__: object) -> subprocess.CompletedProcess[bytes]:
        return subprocess.CompletedProcess([], -11, b"", b"")

    monkeypatch.setattr("subprocess.run", died)
    with pytest.raises(InputError, match="the reader failed"):
        read_ply(path, InputPolicy(repair=True))
