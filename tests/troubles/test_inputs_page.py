"""The commands and scripts of docs/inputs.md, each section's in its order, on trees laid out as it says."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import decode_sequence, probe
from dfcgs_codec.array_types import AnyArray
from dfcgs_codec.ply.formats import reader_installed
from tests.helpers import ROOT
from tests.troubles import foreign_formats as foreign
from tests.troubles.situations import ball, run, write

PAGE = (ROOT / "docs" / "inputs.md").read_text()
SECTIONS = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE))
#: frames 1, 2, ..., 10, so that 2 is before 10
LAST = 10
NUMBERS = range(1, LAST + 1)
N = 30
Columns = dict[str, AnyArray]
Build = Callable[[], None]


def frame(number: int, n: int = N) -> Columns:
    """A frame that can be told from others: it is where its number says."""
    columns = ball(n, sh_degree=1)
    return {**columns, "x": columns["x"] + np.float32(10 * number)}


def added(number: int) -> Columns:
    """Gaussians in the same place that one frame has more: as many as its number."""
    return frame(number, number)


def stream() -> None:
    write(Path("flame_steak_init/point_cloud/iteration_7000/point_cloud.ply"), frame(5, 3))
    write(Path("flame_steak_init/point_cloud/iteration_15000/point_cloud.ply"), frame(0))
    for number in NUMBERS:
        folder = Path(f"output/flame_steak/frame{number:06d}")
        write(folder / "point_cloud/iteration_150/point_cloud.ply", frame(number))
        write(folder / "point_cloud/iteration_250/added/point_cloud.ply", added(number))
        (folder / "NTC.pth").write_bytes(b"PK weights")


def without_colours(columns: Columns) -> Columns:
    return {name: values for name, values in columns.items() if not name.startswith("f_")}


def gc() -> None:
    for number in NUMBERS:
        folder = Path(f"outputs/coffee_martini/colmap_{number}")
        write(folder / "point_cloud/iteration_400/point_cloud.ply", frame(0))
        write(folder / "point_cloud/iteration_500/point_cloud.ply", frame(number))
        write(folder / "point_cloud/iteration_500/added/point_cloud.ply", added(number))
        exp_sh = folder / "point_cloud/iteration_500/added/point_cloud_exp_sh.ply"
        write(exp_sh, without_colours(added(number)))
        (folder / "MEM.pth").write_bytes(b"PK weights")


def queen() -> None:
    for number in NUMBERS:
        folder = Path(f"output/coffee_martini_trained/frames/{number:04d}")
        columns = {**frame(number), "vertex_id": np.arange(N, dtype="i4")}
        write(folder / "point_cloud.ply", columns)
        iteration = 10000 if number == 1 else 200
        write(folder / f"point_cloud/iteration_{iteration}/point_cloud.ply", columns)
        if number > 1:
            (folder / "compressed").mkdir()
            (folder / "compressed/point_cloud.pkl").write_bytes(b"\x80 latents")


def hicom() -> None:
    folder = Path("output/coffee_martini/point_cloud")
    write(folder / "gaussians-0-15000.ply", frame(0))
    for number in NUMBERS:
        write(folder / f"initial-gaussians-{number}.ply", frame(number))
        write(folder / f"gaussians-{number}-200.ply", added(number))


def tracked() -> None:
    frames = [frame(number) for number in range(LAST + 1)]

    def stacked(*names: str) -> AnyArray:
        return np.stack([np.stack([columns[name] for name in names], axis=1) for columns in frames])

    path = Path("output/exp1/basketball/params.npz")
    path.parent.mkdir(parents=True)
    np.savez(
        path.with_suffix(""),
        means3D=stacked("x", "y", "z"),
        rgb_colors=0.5 + 0.25 * stacked("f_dc_0", "f_dc_1", "f_dc_2"),
        seg_colors=np.zeros((N, 3), "f4"),
        unnorm_rotations=stacked("rot_0", "rot_1", "rot_2", "rot_3"),
        logit_opacities=stacked("opacity")[0],
        log_scales=stacked("scale_0", "scale_1", "scale_2")[0],
        cam_m=np.zeros((50, 3), "f4"),
        cam_c=np.zeros((50, 3), "f4"),
    )


def trainings() -> None:
    for number in NUMBERS:
        model = Path(f"scene/frame_{number:04d}")
        write(model / "point_cloud/iteration_7000/point_cloud.ply", frame(0))
        write(model / "point_cloud/iteration_30000/point_cloud.ply", frame(number))
        write(model / "input.ply", {name: frame(number)[name] for name in "xyz"})
        write(Path(f"results/frame_{number}/ply/point_cloud_6999.ply"), frame(0))
        write(Path(f"results/frame_{number}/ply/point_cloud_29999.ply"), without_normals(frame(number)))
        write(Path(f"exports/frame_{number:04d}/splat.ply"), frame(number))


def without_normals(columns: Columns) -> Columns:
    return {name: values for name, values in columns.items() if name not in ("nx", "ny", "nz")}


def numbered() -> None:
    Path("packed").mkdir()
    for number in NUMBERS:
        write(Path(f"frames/frame_{number:04d}.ply"), frame(number))
        packed = foreign.compressed_ply(frame(number))
        Path(f"packed/frame_{number:04d}.compressed.ply").write_bytes(packed)


#: section -> what makes its tree, and the numbers of frames and of added Gaussians in each file it encodes
BUILT: dict[str, tuple[Build, dict[str, tuple[int, bool]]]] = {
    "3DGStream": (stream, {"moved.dgs": (0, False), "whole.dgs": (0, True)}),
    "4DGC": (gc, {"out.dgs": (1, False)}),
    "QUEEN": (queen, {"out.dgs": (1, False)}),
    "HiCoM": (hicom, {"out.dgs": (0, True)}),
    "Dynamic 3D Gaussians": (tracked, {"out.dgs": (0, False), "same.dgs": (0, False)}),
    "One training for each frame": (
        trainings,
        {"out.dgs": (1, False), "gsplat.dgs": (1, False), "nerfstudio.dgs": (1, False)},
    ),
    "SuperSplat and splat-transform": (numbered, {"out.dgs": (1, False), "packed.dgs": (1, False)}),
}


def run_line(line: str) -> None:
    """A command of the page: `dfcgs`, or one of the two others that it has."""
    command, *arguments = shlex.split(line)
    if command == "dfcgs":
        # in one process, and at a QP: no quality is searched for
        done = run(*arguments, *(["--jobs", "1", "--qp", "27"] if arguments[0] == "encode" else []))
        assert done.code == 0, done.err
    elif command == "mkdir":
        assert arguments[0] == "-p"
        Path(arguments[1]).mkdir(parents=True)
    else:
        assert (command, arguments[0]) == ("cp", "-r")
        shutil.copytree(arguments[1], Path(arguments[2]) / Path(arguments[1]).name)


def run_section(text: str) -> None:
    for kind, block in re.findall(r"```(sh|python)\n(.*?)```", text, re.DOTALL):
        if kind == "python":
            exec(compile(block, "docs/inputs.md", "exec"), {"__name__": "__main__"})
        else:
            for line in block.splitlines():
                run_line(line)


def check_frames(path: Path, first: int, with_added: bool) -> None:
    """All frames to the last are there, in their order, under numbers that follow each other."""
    numbers = list(range(first, LAST + 1))
    assert probe(path).as_dict()["num_frames"] == len(numbers)
    for number, decoded in zip(numbers, decode_sequence(path), strict=True):
        cloud = decoded.cloud()
        assert decoded.number == number
        assert cloud.positions[:, 0] == pytest.approx(10 * number, abs=2)
        assert cloud.num_gaussians == N + number * with_added


def test_every_section_is_built() -> None:
    assert set(BUILT) == set(SECTIONS)


@pytest.mark.parametrize("section", BUILT)
def test_section(section: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "packed" in SECTIONS[section] and not reader_installed():
        pytest.skip("compressed PLYs are read with the extra formats")
    build, files = BUILT[section]
    monkeypatch.chdir(tmp_path)
    build()
    run_section(SECTIONS[section])
    assert {path.name for path in tmp_path.glob("*.dgs")} == set(files)
    for name, (first, with_added) in files.items():
        check_frames(tmp_path / name, first, with_added)


@pytest.mark.parametrize("section", BUILT)
def test_trees_are_as_the_page_shows_them(
    section: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    BUILT[section][0]()
    shown = re.findall(r"^(\w\S*/\S+\.\w+)(?: |$)", SECTIONS[section], re.MULTILINE)
    assert shown
    for name in shown:
        assert Path(name).is_file(), name


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("3DGStream", "10 PLYs in folders called 'added'"),
        ("3DGStream", "which the frames as taken lack; docs/inputs.md joins them"),
        ("4DGC", "which it already holds"),
        ("QUEEN", "the frame itself lies beside their folder: frames/0001/point_cloud/iteration_10000"),
        ("QUEEN", "left out: vertex_id"),
    ],
)
def test_what_is_left_out_is_said(
    section: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    BUILT[section][0]()
    line = re.search(r"^dfcgs encode .*", SECTIONS[section], re.MULTILINE)
    assert line is not None
    assert said in run(*shlex.split(line[0])[1:], "--jobs", "1").err


def test_the_line_for_hicom_is_in_its_words() -> None:
    assert "self.gaussians.save_ply(save_path)" in SECTIONS["HiCoM"]
