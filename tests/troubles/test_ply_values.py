"""What stands in the rows: scales, filters, colours, doubles, and values that are not numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import InputPolicy, peek_header, read_ply, write_ply
from tests.helpers import alphas
from tests.troubles.situations import ball, encode, moved, run, write

REPAIR, DROP, BAKE = InputPolicy(repair=True), InputPolicy(drop_extra=True), InputPolicy(bake_filter=True)
SH_C0 = 0.28209479177387814


def refusal(path: Path, policy: InputPolicy | None = None) -> str:
    """By the header alone; reading refuses in the same words."""
    with pytest.raises(InputError) as peeked:
        peek_header(path, policy)
    with pytest.raises(InputError) as read:
        read_ply(path, policy)
    assert str(read.value) == str(peeked.value)
    assert str(read.value).startswith(f"{path}: ")
    return str(read.value)


# --- other properties than those of 3DGS --------------------------------------------------------------


def test_two_scales_get_a_flat_third(tmp_path: Path) -> None:
    columns = ball(40)
    del columns["scale_2"]
    path = write(tmp_path / "a.ply", columns)
    header = peek_header(path)
    assert header.flat
    assert "two scales (2D Gaussians); the third is set to -20" in header.remarks[0]
    cloud, notes = read_ply(path)
    assert notes == []
    assert np.array_equal(cloud.scales[:, :2], np.stack([columns["scale_0"], columns["scale_1"]], axis=1))
    assert (cloud.scales[:, 2] == -20).all()
    columns["scale_1"][3] = -30
    assert read_ply(write(path, columns))[0].scales[3, 2] == -30


def test_flat_discs_cost_no_more_than_thick_ones(tmp_path: Path) -> None:
    sizes = []
    for name in ("flat", "thick"):
        for t in range(2):
            columns = moved(ball(300), 0.02 * t)
            columns["scale_2"] = np.full(300, -7, "f4")
            if name == "flat":
                del columns["scale_2"]
            write(tmp_path / name / f"{t}.ply", columns)
        assert encode(tmp_path / name, tmp_path / f"{name}.dgs").code == 0
        sizes.append((tmp_path / f"{name}.dgs").stat().st_size)
    assert sizes[0] < 1.03 * sizes[1]
    assert run("decode", tmp_path / "flat.dgs", tmp_path / "out").code == 0
    assert (read_ply(tmp_path / "out" / "frame_0001.ply")[0].scales.min(axis=1) < -15).all()


def test_filter_3d_is_refused_or_baked(tmp_path: Path) -> None:
    columns = ball(50)
    width = np.linspace(0, 0.05, 50).astype("f4")
    path = write(tmp_path / "a.ply", columns | {"filter_3D": width})
    for policy in (None, DROP, REPAIR):
        message = refusal(path, policy)
        assert "filter_3D" in message
        assert message.rpartition("; ")[2].count("--bake-filter") == 1
    assert peek_header(path, BAKE).remarks == ("filter_3D is put into scale and opacity",)
    cloud, _ = read_ply(path, BAKE)
    squares = np.exp(2 * np.stack([columns[f"scale_{i}"] for i in range(3)], axis=1).astype("f8"))
    wide = squares + width[:, None].astype("f8") ** 2
    ratio = np.sqrt(squares.prod(axis=1) / wide.prod(axis=1))
    assert np.allclose(np.exp(2 * cloud.scales.astype("f8")), wide, rtol=1e-5)
    assert np.allclose(alphas(cloud), ratio / (1 + np.exp(-columns["opacity"].astype("f8"))), rtol=1e-5)
    assert cloud.opacities[0] == columns["opacity"][0]


def test_a_filter_of_an_opaque_flat_or_broken_gaussian(tmp_path: Path) -> None:
    columns = ball(5) | {"filter_3D": np.array([0, 1, 1, 1, np.nan], "f4")}
    columns["opacity"][:4] = [40, 40, -40, np.inf]
    columns["scale_2"][3] = -np.inf
    path = write(tmp_path / "a.ply", columns)
    with pytest.raises(InputError, match="NaN"):
        read_ply(path, BAKE)
    cloud, _ = read_ply(path, InputPolicy(bake_filter=True, repair=True))
    assert np.isfinite(cloud.opacities).all()
    assert cloud.opacities[0] == 40
    assert cloud.scales[3, 2] == 0
    assert cloud.opacities[4] < -10


def test_the_command_line_bakes_filters(tmp_path: Path) -> None:
    for t in range(2):
        frame = moved(ball(100), 0.02 * t) | {"filter_3D": np.full(100, 0.01, "f4")}
        write(tmp_path / "in" / f"{t}.ply", frame)
    assert encode(tmp_path / "in", tmp_path / "a.dgs", "--drop-extra").code == 1
    done = encode(tmp_path / "in", tmp_path / "a.dgs", "--bake-filter")
    assert done.code == 0
    assert "note: 0.ply and 1 more: filter_3D is put into scale and opacity" in done.err


def test_sh_degree_4(tmp_path: Path) -> None:
    rest = {f"f_rest_{i}": np.full(4, i, "f4") for i in range(72)}
    path = write(tmp_path / "a.ply", ball(4) | rest)
    assert "SH degree 4 (72 f_rest_* properties)" in refusal(path)
    header = peek_header(path, DROP)
    assert (header.sh_degree, header.dropped) == (3, ("the f_rest_* of SH degree 4",))
    cloud, _ = read_ply(path, DROP)
    assert cloud.sh_rest[0].tolist() == [[24 * c + i for i in range(15)] for c in range(3)]


def test_cloudcompare_names(tmp_path: Path) -> None:
    columns = ball(6, sh_degree=1)
    plain = read_ply(write(tmp_path / "b.ply", columns))[0]
    renamed = {k if k in ("x", "y", "z", "nx", "ny", "nz") else f"scalar_{k}": v for k, v in columns.items()}
    path = write(tmp_path / "a.ply", renamed)
    assert "names of properties begin with scalar_ (CloudCompare)" in peek_header(path).remarks[0]
    assert np.array_equal(read_ply(path)[0].sh_rest, plain.sh_rest)
    refused = write(path, renamed | {"scalar_time": np.zeros(6, "f4")})
    assert "does not keep: scalar_time; --drop-extra" in refusal(refused)


def test_rgb_in_place_of_sh(tmp_path: Path) -> None:
    columns = ball(6)
    colours = [columns.pop(f"f_dc_{i}") for i in range(3)]
    levels = [np.clip(np.round(255 * (0.5 + SH_C0 * c)), 0, 255) for c in colours]
    names = ("red", "green", "blue")
    path = write(
        tmp_path / "a.ply", columns | {n: v.astype("u1") for n, v in zip(names, levels, strict=True)}
    )
    assert "red, green, blue in place of f_dc_0" in refusal(path)
    cloud, _ = read_ply(path, DROP)
    assert np.allclose(0.5 + SH_C0 * cloud.sh_dc, np.stack(levels, axis=1) / 255, atol=1e-6)
    write(path, columns | {n: v.astype("f4") for n, v in zip(names, levels, strict=True)})
    assert "not of type uchar" in refusal(path, DROP)


NO_3DGS = {
    "a point cloud": ({"red": "u1", "green": "u1", "blue": "u1"}, "", b"", "a point cloud (x, y, z, red"),
    "points": ({}, "", b"", "a point cloud (x, y, z)"),
    "a mesh": (
        {},
        "element face 1\nproperty list uchar int vertex_indices",
        b"\x01" + bytes(4),
        "a mesh (x, y, z)",
    ),
}


@pytest.mark.parametrize("name", NO_3DGS)
def test_plys_without_gaussians(tmp_path: Path, name: str) -> None:
    more, after, tail, words = NO_3DGS[name]
    columns: dict[str, npt.NDArray] = {axis: np.zeros(5, "f4") for axis in "xyz"}
    columns |= {key: np.zeros(5, kind) for key, kind in more.items()}
    path = write(tmp_path / "a.ply", columns, after=after, tail=tail)
    assert words in refusal(path)
    assert "no 3D Gaussians" in refusal(path)


# --- types --------------------------------------------------------------------------------------------


def test_doubles_stay_doubles(tmp_path: Path) -> None:
    columns: dict[str, npt.NDArray] = dict(ball(7))
    columns["y"] = 4_500_000 + np.arange(7) / 3
    columns["opacity"] = columns["opacity"].astype("f8")
    cloud, _ = read_ply(write(tmp_path / "a.ply", columns))
    found = {name: getattr(cloud, name).dtype for name in ("positions", "opacities", "scales", "sh_rest")}
    assert found == {"positions": "f8", "opacities": "f8", "scales": "f4", "sh_rest": "f4"}
    assert np.array_equal(cloud.positions[:, 1], columns["y"])
    write_ply(tmp_path / "b.ply", cloud)
    header = (tmp_path / "b.ply").read_bytes().partition(b"end_header")[0]
    assert header.count(b"property double ") == 4
    again, _ = read_ply(tmp_path / "b.ply")
    for name in vars(cloud):
        assert getattr(again, name).tobytes() == getattr(cloud, name).tobytes()


@pytest.mark.parametrize(("kind", "dtype"), [("u1", "f4"), ("i4", "f8"), ("u4", "f8")])
def test_integers_are_kept_exactly(tmp_path: Path, kind: str, dtype: str) -> None:
    columns: dict[str, npt.NDArray] = dict(ball(3))
    columns["x"] = np.array([0, 200, np.iinfo(kind).max], kind)
    cloud, _ = read_ply(write(tmp_path / "a.ply", columns))
    assert cloud.positions.dtype == dtype
    assert np.array_equal(cloud.positions[:, 0], columns["x"].astype("f8"))


def test_keep_bits_keeps_every_pattern(tmp_path: Path) -> None:
    columns = ball(4)
    columns["x"] = np.array([0x7FC00001, 0xFF800000, 0x00000001, 0x7FA00000], "u4").view("f4")
    for i in range(4):
        columns[f"rot_{i}"][:] = 0
    cloud, notes = read_ply(write(tmp_path / "a.ply", columns), InputPolicy(keep_bits=True))
    assert notes == []
    assert cloud.positions[:, 0].tobytes() == columns["x"].tobytes()


# --- repair: what viewers show ------------------------------------------------------------------------


def repaired(tmp_path: Path, **values: float) -> tuple[GaussianCloud, GaussianCloud, str, str]:
    """Without and with `values` in Gaussian 2 of 9, the refusal and the note."""
    columns = ball(9, sh_degree=1)
    whole, _ = read_ply(write(tmp_path / "a.ply", columns))
    for name, value in values.items():
        columns[name][2] = value
    path = write(tmp_path / "a.ply", columns)
    with pytest.raises(InputError) as caught:
        read_ply(path)
    cloud, notes = read_ply(path, REPAIR)
    assert len(notes) == 1
    for name in vars(cloud):
        assert np.isfinite(getattr(cloud, name)).all()
        others = np.arange(9) != 2
        assert np.array_equal(getattr(cloud, name)[others], getattr(whole, name)[others])
    return whole, cloud, str(caught.value), notes[0]


def test_minus_infinite_scale_is_flat(tmp_path: Path) -> None:
    whole, cloud, refused, note = repaired(tmp_path, scale_1=-np.inf)
    assert cloud.scales[2].tolist() == [whole.scales[2, 0], -20, whole.scales[2, 2]]
    assert cloud.opacities[2] == whole.opacities[2]
    assert (
        "1 values of scale_0..scale_2 are NaN or infinite (1 -inf), first 'scale_1' of Gaussian 2" in refused
    )
    assert refused.endswith("; --repair puts what viewers show: -inf of a scale as -20 (flat)")
    assert note.startswith("a.ply: 1 values of scale_0..scale_2")


@pytest.mark.parametrize(("value", "alpha"), [(np.inf, 1.0), (-np.inf, 0.0)])
def test_infinite_opacity_is_alpha_1_or_0(tmp_path: Path, value: float, alpha: float) -> None:
    whole, cloud, refused, _ = repaired(tmp_path, opacity=value)
    assert abs(alphas(cloud)[2] - alpha) < 1e-6
    assert np.array_equal(cloud.positions, whole.positions)
    assert np.array_equal(cloud.scales, whole.scales)
    assert "alpha 1 or 0" in refused


INVISIBLE: dict[str, dict[str, float]] = {
    "NaN position": {"y": np.nan},
    "infinite position": {"x": np.inf},
    "infinite scale": {"scale_0": np.inf},
    "NaN scale": {"scale_2": np.nan},
    "NaN opacity": {"opacity": np.nan},
    "NaN rotation": {"rot_1": np.nan},
    "NaN colour": {"f_dc_0": np.nan},
    "NaN coefficient": {"f_rest_8": np.nan},
    "never written": dict.fromkeys(ball(1, sh_degree=1), 0.0),
    "NaN in all": dict.fromkeys(ball(1, sh_degree=1), np.nan) | dict.fromkeys(("nx", "ny", "nz"), 0.0),
    "no quaternion, no scale": dict.fromkeys(["rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1"], 0.0)
    | {"scale_2": 0.0},
}


@pytest.mark.parametrize("name", INVISIBLE)
def test_what_viewers_do_not_draw_is_invisible(tmp_path: Path, name: str) -> None:
    whole, cloud, refused, note = repaired_any(tmp_path, INVISIBLE[name])
    assert alphas(cloud)[2] < 1e-6
    assert (np.abs(cloud.positions[2]) <= np.abs(whole.positions).max(axis=0)).all()
    assert (cloud.scales[2] <= whole.scales.max(axis=0)).all()
    assert np.linalg.norm(cloud.rotations[2]) > 0.1
    assert "of Gaussian 2" in refused
    assert "--repair" in refused.rpartition("; ")[2]
    assert "1 Gaussian invisible" in note


def repaired_any(tmp_path: Path, values: dict[str, float]) -> tuple[GaussianCloud, GaussianCloud, str, str]:
    """As `repaired`, for values of several attributes."""
    columns = ball(9, sh_degree=1)
    whole, _ = read_ply(write(tmp_path / "a.ply", columns))
    for name, value in values.items():
        columns[name][2] = value
    path = write(tmp_path / "a.ply", columns)
    with pytest.raises(InputError) as caught:
        read_ply(path)
    cloud, notes = read_ply(path, REPAIR)
    return whole, cloud, str(caught.value), " | ".join(notes)


def test_a_zero_quaternion_alone_is_no_rotation(tmp_path: Path) -> None:
    whole, cloud, _, note = repaired(tmp_path, rot_0=0, rot_1=0, rot_2=0, rot_3=0)
    assert cloud.rotations[2].tolist() == [1, 0, 0, 0]
    assert np.array_equal(cloud.opacities, whole.opacities)
    assert "zero quaternions as no rotation" in note


def test_a_frame_of_nothing_but_zeros_is_repaired(tmp_path: Path) -> None:
    path = write(tmp_path / "a.ply", {name: 0 * values for name, values in ball(5).items()})
    cloud, notes = read_ply(path, REPAIR)
    assert (alphas(cloud) < 1e-6).all()
    assert "5 Gaussians invisible" in notes[0]


def test_doubles_beyond_float32_count_as_infinite(tmp_path: Path) -> None:
    columns: dict[str, npt.NDArray] = dict(ball(5))
    columns["scale_1"] = columns["scale_1"].astype("f8")
    columns["scale_1"][3] = -1e300
    path = write(tmp_path / "a.ply", columns)
    with pytest.raises(InputError, match=r"\(1 -inf\), first 'scale_1' of Gaussian 3"):
        read_ply(path)
    assert read_ply(path, REPAIR)[0].scales[3, 1] == -20


def test_rows_of_zeros_do_not_show_after_a_round_trip(tmp_path: Path) -> None:
    for t in range(2):
        frame = moved(ball(300), 0.02 * t)
        for values in frame.values():
            values[::5] = 0
        write(tmp_path / "in" / f"{t}.ply", frame)
    refused = encode(tmp_path / "in", tmp_path / "a.dgs")
    assert refused.code == 1
    assert "60 quaternions rot_0..rot_3 are zero" in refused.err
    assert "--repair" in refused.err
    done = encode(tmp_path / "in", tmp_path / "a.dgs", "--repair", "--order", "input")
    assert done.code == 0
    assert "note: 0.ply and 1 more: 60 quaternions" in done.err
    assert run("decode", tmp_path / "a.dgs", tmp_path / "out").code == 0
    for path in sorted((tmp_path / "out").iterdir()):
        cloud, _ = read_ply(path)
        faint = cloud.take(np.arange(0, 300, 5))
        assert alphas(faint).max() < 0.1
        assert alphas(faint).mean() < 0.02
        assert faint.scales.max() < ball(300)["scale_0"].max() + 0.3
        # on the ball as the others are, and not all in one place
        assert (np.linalg.norm(faint.positions, axis=1) > 0.6).all()
        assert len(np.unique(faint.positions.round(1), axis=0)) > 50
