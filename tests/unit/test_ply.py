from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import recfunctions

from dfcgs_codec.errors import InputError
from dfcgs_codec.ply import InputPolicy, PlyHeader, peek_header, property_names, read_ply, write_ply
from lab.small_clouds import ASSET, make_cloud, real_cloud, same_cloud
from tests.helpers import ply_table, write_table

DROP, REPAIR = InputPolicy(drop_extra=True), InputPolicy(repair=True)
REQUIRED = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1"]
REQUIRED += ["rot_0", "rot_1", "rot_2", "rot_3"]


def refusal(path: Path, policy: InputPolicy | None = None) -> str:
    """The one line that says why the file is refused; it names the file."""
    with pytest.raises(InputError) as caught:
        read_ply(path, policy)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def with_value(path: Path, name: str, row: int, value: float) -> Path:
    table = ply_table(make_cloud(6, 1))
    table[name][row] = value
    return write_table(path, table)


# --- what is read -------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("layout", [{}, {"byte_order": ">"}, {"text": True}])
def test_all_encodings_are_read(tmp_path: Path, degree: int, layout: dict) -> None:
    cloud = make_cloud(20, degree)
    path = write_table(tmp_path / "a.ply", ply_table(cloud), **layout)
    found, notes = read_ply(path)
    assert notes == []
    assert found.sh_rest.shape == cloud.sh_rest.shape
    if layout.get("text"):
        assert np.allclose(found.positions, cloud.positions, rtol=1e-6)
        assert np.allclose(found.sh_rest, cloud.sh_rest, rtol=1e-6)
    else:
        assert same_cloud(found, cloud)
    assert peek_header(path) == PlyHeader(20, degree)


def test_sh_coefficients_are_channel_first() -> None:
    table = ply_table(make_cloud(3, 1))
    cloud = make_cloud(3, 1)
    assert np.array_equal(table["f_rest_0"], cloud.sh_rest[:, 0, 0])
    assert np.array_equal(table["f_rest_3"], cloud.sh_rest[:, 1, 0])
    assert np.array_equal(table["f_rest_8"], cloud.sh_rest[:, 2, 2])


def test_properties_are_found_by_name(tmp_path: Path) -> None:
    table = ply_table(make_cloud(9, 2))
    backwards = recfunctions.repack_fields(table[list(table.dtype.names[::-1])])
    found, _ = read_ply(write_table(tmp_path / "a.ply", backwards))
    assert same_cloud(found, make_cloud(9, 2))


def test_doubles_and_integers_are_read(tmp_path: Path) -> None:
    table = ply_table(make_cloud(4))
    types = [(n, "<f8" if n != "x" else "<i2") for n in table.dtype.names]
    wide = np.zeros(4, types)
    for name in table.dtype.names:
        wide[name] = table[name]
    wide["x"] = [1, -2, 3, 7000]
    found, _ = read_ply(write_table(tmp_path / "a.ply", wide))
    assert found.positions[:, 0].tolist() == [1, -2, 3, 7000]
    assert np.array_equal(found.scales, make_cloud(4).scales)


def test_the_real_asset_is_read() -> None:
    assert peek_header(ASSET) == PlyHeader(31000, 2)
    assert np.isfinite(real_cloud(500).positions).all()


def test_missing_or_zero_normals_are_fine(tmp_path: Path) -> None:
    table = ply_table(make_cloud(5))
    without = recfunctions.drop_fields(table, ["nx", "ny", "nz"], usemask=False)
    found, _ = read_ply(write_table(tmp_path / "a.ply", without))
    assert same_cloud(found, make_cloud(5))


# --- what is written ----------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", range(4))
def test_write_is_the_inverse_of_read(tmp_path: Path, degree: int) -> None:
    cloud = make_cloud(11, degree)
    write_ply(tmp_path / "a.ply", cloud)
    assert same_cloud(read_ply(tmp_path / "a.ply")[0], cloud)


def test_the_file_has_the_inria_layout(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", make_cloud(11, 3))
    data = (tmp_path / "a.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    lines = header.decode().splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 11"]
    assert lines[3:] == [f"property float {name}" for name in property_names(3)]
    assert len(body) == 11 * 4 * 62
    assert np.array_equal(
        np.frombuffer(body, ply_table(make_cloud(1, 3)).dtype), ply_table(make_cloud(11, 3))
    )


def test_property_order() -> None:
    names = property_names(1)
    assert names[:9] == ("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2")
    assert names[9:18] == tuple(f"f_rest_{i}" for i in range(9))
    assert names[18:] == ("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")


# --- what is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REQUIRED)
def test_a_missing_property_is_named(tmp_path: Path, name: str) -> None:
    table = recfunctions.drop_fields(ply_table(make_cloud(5)), [name], usemask=False)
    assert f"property '{name}' is missing" in refusal(write_table(tmp_path / "a.ply", table))


def test_a_missing_sh_coefficient_is_refused(tmp_path: Path) -> None:
    table = recfunctions.drop_fields(ply_table(make_cloud(5, 1)), ["f_rest_4"], usemask=False)
    path = write_table(tmp_path / "a.ply", table)
    assert "8 f_rest_* properties; 0, 9, 24 or 45" in refusal(path)
    with pytest.raises(InputError, match="8 f_rest"):
        peek_header(path)


def test_a_gap_in_the_sh_numbering_is_named(tmp_path: Path) -> None:
    table = ply_table(make_cloud(5, 1))
    renamed = recfunctions.rename_fields(table, {"f_rest_4": "f_rest_40"})
    assert "property 'f_rest_4' is missing" in refusal(write_table(tmp_path / "a.ply", renamed))


def test_extra_properties_are_refused_or_dropped(tmp_path: Path) -> None:
    table = recfunctions.append_fields(ply_table(make_cloud(5)), "velocity", np.ones(5, "<f4"), usemask=False)
    path = write_table(tmp_path / "a.ply", table)
    message = refusal(path)
    assert "velocity" in message
    assert "--drop-extra" in message
    assert same_cloud(read_ply(path, DROP)[0], make_cloud(5))


def test_normals_that_are_not_zero_are_refused_or_dropped(tmp_path: Path) -> None:
    path = with_value(tmp_path / "a.ply", "ny", 2, 0.5)
    assert "does not keep: ny;" in refusal(path)
    assert same_cloud(read_ply(path, DROP)[0], make_cloud(6, 1))


@pytest.mark.parametrize("name", ["x", "z", "f_dc_1", "f_rest_8", "opacity", "scale_2", "rot_3"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_counted_and_located(tmp_path: Path, name: str, value: float) -> None:
    path = with_value(tmp_path / "a.ply", name, 4, value)
    message = refusal(path)
    assert "1 values of" in message
    assert f"first '{name}' of Gaussian 4" in message
    assert "--repair" in message


def test_the_count_is_that_of_all_bad_values(tmp_path: Path) -> None:
    table = ply_table(make_cloud(9))
    table["scale_1"][[3, 7]] = np.nan
    table["scale_0"][7] = np.inf
    message = refusal(write_table(tmp_path / "a.ply", table))
    assert "3 values of scale_0..scale_2" in message
    assert "first 'scale_1' of Gaussian 3" in message


def test_repair_replaces_only_what_is_not_finite(tmp_path: Path) -> None:
    path = with_value(tmp_path / "a.ply", "f_rest_8", 4, np.nan)
    found, notes = read_ply(path, REPAIR)
    expected = make_cloud(6, 1).sh_rest.copy()
    expected[4, 2, 2] = 0
    assert np.array_equal(found.sh_rest, expected)
    assert len(notes) == 1
    assert notes[0].startswith("a.ply: 1 values of f_rest_0..f_rest_8")


def test_zero_quaternions_are_refused_or_repaired(tmp_path: Path) -> None:
    cloud = make_cloud(6)
    rotations = cloud.rotations.copy()
    rotations[[2, 5]] = 0
    path = write_table(tmp_path / "a.ply", ply_table(replace(cloud, rotations=rotations)))
    assert "2 quaternions rot_0..rot_3 are zero, first of Gaussian 2" in refusal(path)
    found, notes = read_ply(path, REPAIR)
    rotations[[2, 5]] = (1, 0, 0, 0)
    assert np.array_equal(found.rotations, rotations)
    assert "2 quaternions" in notes[0]


def test_a_quaternion_of_nan_is_repaired_to_a_rotation(tmp_path: Path) -> None:
    table = ply_table(make_cloud(3))
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        table[name][1] = np.nan
    found, notes = read_ply(write_table(tmp_path / "a.ply", table), REPAIR)
    assert found.rotations[1].tolist() == [1, 0, 0, 0]
    assert len(notes) == 1


def test_a_tiny_quaternion_is_a_rotation(tmp_path: Path) -> None:
    table = ply_table(make_cloud(3))
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        table[name] = np.float32(1e-42)
    found, _ = read_ply(write_table(tmp_path / "a.ply", table))
    assert (found.rotations != 0).all()


def test_a_frame_without_gaussians_is_read(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.ply", ply_table(make_cloud(1))[:0])
    assert read_ply(path)[0].num_gaussians == 0
    assert peek_header(path) == PlyHeader(0, 0)


@pytest.mark.parametrize("cut", [0, 3, 30, 200, -1, -100])
def test_a_truncated_file_is_refused(tmp_path: Path, cut: int) -> None:
    path = write_table(tmp_path / "a.ply", ply_table(make_cloud(6, 1)))
    path.write_bytes(path.read_bytes()[:cut])
    refusal(path)


@pytest.mark.parametrize(
    "content", [b"", b"not a ply", b"\x89PNG\r\n\x1a\n", b"\x00" * 5000, b"ply\n" * 2000]
)
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    refusal(path)
    with pytest.raises(InputError, match=r"a\.ply"):
        peek_header(path)


def test_a_header_that_never_ends_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1\n")
    with pytest.raises(InputError, match="no end_header"):
        peek_header(path)


def test_a_mesh_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    lines = ["ply", "format ascii 1.0", "element vertex 1", "property float x", "property float y"]
    lines += ["property float z", "element face 1", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*lines, "0 0 0", "3 0 0 0", ""]))
    assert "property 'f_dc_0' is missing" in refusal(path)


def test_a_ply_without_vertices_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text("ply\nformat ascii 1.0\nelement thing 1\nproperty float x\nend_header\n0\n")
    with pytest.raises(InputError, match="element vertex"):
        peek_header(path)
    refusal(path)


def test_a_list_property_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_table(path, ply_table(make_cloud(2)), text=True)
    text = path.read_text().replace("property float opacity", "property list uchar float opacity")
    lines = text.splitlines()
    start = lines.index("end_header") + 1
    for row in range(start, len(lines)):
        values = lines[row].split()
        lines[row] = " ".join([*values[:9], "1", *values[9:]])
    path.write_text("\n".join(lines) + "\n")
    assert "property 'opacity' is a list" in refusal(path)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    refusal(tmp_path / "missing.ply")


def test_other_elements_are_no_part_of_the_frame(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.ply", ply_table(make_cloud(2)), text=True)
    text = path.read_text().replace("end_header", "element face 1\nproperty float f_rest_0\nend_header")
    path.write_text(text + "5\n")
    assert "elements that the codec does not keep: face; --drop-extra" in refusal(path)
    assert peek_header(path, DROP).sh_degree == 0
    assert read_ply(path, DROP)[0].num_gaussians == 2
