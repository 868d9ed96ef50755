"""The params.npz of Dynamic 3D Gaussians as frames."""

from __future__ import annotations

import io
import pickle
import re
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import InputError, InputPolicy, decode_sequence, encode_sequence, open_folder
from dfcgs_codec.arrays.archive import Archive
from dfcgs_codec.arrays.params import open_params
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import TimestepSource, open_frames
from lab.small_clouds import same_cloud
from tests.helpers import QUICK, frame_hashes, write_frames
from tests.troubles.situations import run

SH_C0 = 0.28209479177387814
N, T = 60, 5
Arrays = dict[str, Any]


def arrays(n: int = N, timesteps: int = T, dtype: str = "f4") -> Arrays:
    """What the trainer saves: positions, turns and colours of every timestep, the rest once."""
    rng = np.random.default_rng(n)
    step = rng.normal(0, 0.01, (timesteps, n, 3)).cumsum(axis=0)
    turned = rng.normal(0, 0.01, (timesteps, n, 4)).cumsum(axis=0)
    found = {
        "means3D": rng.normal(size=(n, 3)) + step,
        "rgb_colors": rng.uniform(0.1, 0.9, (n, 3)) + step,
        "seg_colors": rng.uniform(size=(n, 3)),
        "unnorm_rotations": rng.normal(size=(n, 4)) + turned,
        "logit_opacities": rng.normal(2, 1, (n, 1)),
        "log_scales": rng.normal(-3, 0.3, (n, 3)),
        "cam_m": np.zeros((50, 3)),
        "cam_c": np.zeros((50, 3)),
    }
    return {name: values.astype(dtype) for name, values in found.items()}


def clouds(found: Arrays) -> list[GaussianCloud]:
    """The same frames, put together here; arrays without a timestep stand for all of them."""

    def at(name: str, t: int) -> Any:
        return found[name][t] if found[name].ndim == 3 else found[name]

    frames = []
    for t in range(max([len(a) for k, a in found.items() if a.ndim == 3 and k != "cam_m"], default=1)):
        colours = at("rgb_colors", t)
        dc = ((colours.astype("f8") - 0.5) / SH_C0).astype(colours.dtype)
        n = len(dc)
        scales = np.broadcast_to(at("log_scales", t), (n, 3))
        opacities = at("logit_opacities", t)[:, 0]
        rest = np.zeros((n, 3, 0), "f4")
        frames.append(GaussianCloud(at("means3D", t), at("unnorm_rotations", t), scales, opacities, dc, rest))
    return frames


def saved(folder: Path, found: Arrays, *, compressed: bool = False, name: str = "params.npz") -> Path:
    path = folder / name
    (np.savez_compressed if compressed else np.savez)(path, **found)
    return path


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        open_frames([path], **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("timesteps", [1, T])
@pytest.mark.parametrize("dtype", ["f4", "f8", ">f4", "f2"])
def test_timesteps_are_frames(tmp_path: Path, compressed: bool, timesteps: int, dtype: str) -> None:
    found = arrays(timesteps=timesteps, dtype=dtype)
    source = open_params(saved(tmp_path, found, compressed=compressed))
    assert source.numbers == list(range(timesteps))
    assert [(h.num_gaussians, h.sh_degree) for h in source.headers] == [(N, 0)] * timesteps
    wide = {name: values.astype("f8" if dtype == "f8" else "f4") for name, values in found.items()}
    for index in (*range(timesteps), 0):
        cloud, notes = source.read(index)
        assert same_cloud(cloud, clouds(wide)[index])
        assert notes == []


@pytest.mark.parametrize(("dtype", "jobs"), [("f4", "1"), ("f8", "2")])
def test_it_encodes_to_what_its_plys_encode_to(tmp_path: Path, dtype: str, jobs: str) -> None:
    found = arrays(dtype=dtype)
    path = saved(tmp_path, found)
    options = ["--gof-size", "2", "--jobs", jobs, "--qp", "27", "--verify"]
    done = run("encode", path, tmp_path / "a.dgs", *options)
    assert done.code == 0, done.err
    assert "params.npz: 5 timesteps of 60 Gaussians" in done.err
    assert "left out: seg_colors, cam_m, cam_c" in done.err
    frames = clouds(found)
    if dtype == "f4":
        write_frames(tmp_path / "plys", frames)
        assert run("encode", tmp_path / "plys", tmp_path / "b.dgs", *options).code == 0
    else:
        encode_sequence(frames, tmp_path / "b.dgs", replace(QUICK, gof_size=2))
    assert frame_hashes(tmp_path / "a.dgs") == frame_hashes(tmp_path / "b.dgs")
    decoded = list(decode_sequence(tmp_path / "a.dgs"))
    assert [frame.number for frame in decoded] == list(range(T))
    for ours, theirs in zip(decoded, decode_sequence(tmp_path / "b.dgs"), strict=True):
        assert same_cloud(ours.cloud(), theirs.cloud())


def test_compressed_ones_are_encoded_by_several_processes(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays(timesteps=7), compressed=True)
    encode_sequence(path, tmp_path / "a.dgs", replace(QUICK, gof_size=2, jobs=2))
    encode_sequence(path, tmp_path / "b.dgs", replace(QUICK, gof_size=2, jobs=1))
    assert (tmp_path / "a.dgs").read_bytes() == (tmp_path / "b.dgs").read_bytes()


def test_python_takes_the_path_the_folder_and_the_source(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays())
    for number, frames in enumerate((path, str(path), tmp_path, open_folder(tmp_path), [path])):
        report = encode_sequence(frames, tmp_path / f"{number}.dgs", QUICK)
        assert len(report.frames) == T
        assert any("5 timesteps" in note for note in report.notes)
        assert (tmp_path / f"{number}.dgs").read_bytes() == (tmp_path / "0.dgs").read_bytes()


def test_plys_come_before_params(tmp_path: Path) -> None:
    saved(tmp_path, arrays())
    write_frames(tmp_path / "plys", clouds(arrays())[:2])
    assert len(open_folder(tmp_path).numbers) == 2
    (tmp_path / "plys").rename(tmp_path.parent / f"{tmp_path.name}_plys")
    assert len(open_folder(tmp_path).numbers) == T


def test_any_array_may_be_for_all_timesteps_or_for_each(tmp_path: Path) -> None:
    found = arrays()
    found["rgb_colors"] = found["rgb_colors"][0]
    found["log_scales"] = np.stack([found["log_scales"] + 0.1 * t for t in range(T)]).astype("f4")
    source = open_params(saved(tmp_path, found))
    for index, cloud in enumerate(clouds(found)):
        assert same_cloud(source.read(index)[0], cloud)


def test_without_timesteps_it_is_one_frame_and_one_scale_is_round(tmp_path: Path) -> None:
    found = arrays(timesteps=1)
    found |= {name: found[name][0] for name in ("means3D", "rgb_colors", "unnorm_rotations")}
    found["log_scales"] = found["log_scales"][:, :1]
    source = open_params(saved(tmp_path, found))
    assert source.numbers == [0]
    assert same_cloud(source.read(0)[0], clouds(found)[0])


def test_frames_without_gaussians(tmp_path: Path) -> None:
    report = encode_sequence(saved(tmp_path, arrays(n=0)), tmp_path / "a.dgs")
    assert len(report.frames) == T


def test_a_timestep_is_read_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []
    fill = Archive._fill

    def noted(self: Archive, member: Any, values: Any, offset: int) -> None:
        sizes.append(values.size)
        fill(self, member, values, offset)

    monkeypatch.setattr(Archive, "_fill", noted)
    source = open_params(saved(tmp_path, arrays()))
    assert sizes == []
    source.read(3)
    assert sorted(sizes) == [N, 3 * N, 3 * N, 3 * N, 4 * N]


@pytest.mark.parametrize("compressed", [False, True])
def test_other_processes_open_it_anew(tmp_path: Path, compressed: bool) -> None:
    source = open_params(saved(tmp_path, arrays(), compressed=compressed))
    source.read(2)
    copy: TimestepSource = pickle.loads(pickle.dumps(source))
    assert same_cloud(copy.read(1)[0], source.read(1)[0])


@pytest.mark.parametrize("compressed", [False, True])
def test_threads_read_at_once(tmp_path: Path, compressed: bool) -> None:
    found = arrays(n=5000, timesteps=8)
    source = open_params(saved(tmp_path, found, compressed=compressed))
    order = np.random.default_rng(1).permutation(np.tile(np.arange(8), 3)).tolist()
    with ThreadPoolExecutor(4) as threads:
        read = list(threads.map(lambda index: source.read(index)[0], order))
    expected = clouds(found)
    assert all(same_cloud(cloud, expected[index]) for index, cloud in zip(order, read, strict=True))


#: what is done to the arrays -> words of the refusal
WRONG: dict[str, tuple[Arrays, list[str]]] = {
    "missing": ({"log_scales": None}, ["no array log_scales (there are", "expected means3D (T, N, 3)"]),
    "another N": ({"log_scales": np.zeros((7, 3), "f4")}, ["log_scales is float32 (7, 3)", "(60, 3)"]),
    "another T": (
        {"rgb_colors": np.zeros((4, N, 3), "f4")},
        ["rgb_colors is float32 (4, 60, 3)", "(60, 3) or (5, 60, 3): 5 timesteps of 60 Gaussians"],
    ),
    "two scales": ({"log_scales": np.zeros((N, 2), "f4")}, ["log_scales is float32 (60, 2)", "(60, 3)"]),
    "no axis": ({"logit_opacities": np.zeros(N, "f4")}, ["(60,), expected float32 or float64 (60, 1)"]),
    "a number": ({"log_scales": np.float32(1)}, ["log_scales is float32 ()", "(60, 3)"]),
    "whole numbers": ({"means3D": np.zeros((T, N, 3), "i4")}, ["means3D is int32", "float32"]),
    "complex": ({"means3D": np.zeros((T, N, 3), "c8")}, ["means3D is complex64", "float32"]),
    "none at all": ({"means3D": np.zeros((0, N, 3), "f4")}, ["0 timesteps"]),
    "objects": ({"means3D": np.array([[1], [2, 3]], object)}, ["means3D holds Python objects (a pickle)"]),
    "objects beside": ({"names": np.array(["a", None], object)}, ["names holds Python objects"]),
    "columns": ({"means3D": np.asfortranarray(np.zeros((T, N, 3), "f4"))}, ["Fortran", "ascontiguousarray"]),
    "more": ({"shs": np.zeros((N, 9), "f4")}, ["arrays that the codec does not keep: shs"]),
}


@pytest.mark.parametrize("situation", WRONG)
def test_it_says_what_was_expected(tmp_path: Path, situation: str) -> None:
    changes, words = WRONG[situation]
    found = {name: values for name, values in (arrays() | changes).items() if values is not None}
    path = saved(tmp_path, found)
    with pytest.raises(InputError) as caught:
        encode_sequence(path, tmp_path / "a.dgs")
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_unknown_arrays_can_be_left_out(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays() | {"shs": np.zeros((N, 9), "f4")})
    assert refusal(path).endswith("encodes without them")
    source = open_frames([path], policy=InputPolicy(drop_extra=True))
    assert "shs" in source.notes[1]


def pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps(arrays()))


def another_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.txt", "nothing")


def empty(path: Path) -> None:
    path.write_bytes(b"")


def halved(path: Path) -> None:
    saved(path.parent, arrays())
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def lying(path: Path) -> None:
    """Far more values than there are bytes."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": (1 << 20, 1 << 20, 3)}
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("means3D.npy", header.getvalue() + b"\0" * 100)


def garbled(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("means3D.npy", b"no array")


def bzipped(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("means3D.npy", b"no array" * 100)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (pickled, "not an .npz file \\(it is a Python pickle"),
        (another_zip, "no array means3D; expected means3D"),
        (empty, "not an .npz file \\(it is empty"),
        (halved, "not an .npz file"),
        (lying, "means3D holds .* bytes, expected"),
        (garbled, "damaged or truncated"),
        (bzipped, "means3D is packed in a way"),
    ],
)
def test_files_that_are_none(tmp_path: Path, spoil: Any, words: str) -> None:
    path = tmp_path / "params.npz"
    spoil(path)
    assert re.search(words, refusal(path))


def read_all(path: Path) -> None:
    source = open_params(path)
    for index in range(T):
        source.read(index)


def test_a_damaged_stream_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays(), compressed=True)
    data = bytearray(path.read_bytes())
    data[100:200] = b"\xff" * 100
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged or truncated"):
        read_all(path)


def test_other_values_than_were_packed_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays(), compressed=True)
    with zipfile.ZipFile(path) as archive:
        crc = archive.getinfo("means3D.npy").CRC.to_bytes(4, "little")
    path.write_bytes(path.read_bytes().replace(crc, bytes(4)))
    with pytest.raises(InputError, match=r"damaged or truncated \(Bad CRC-32"):
        read_all(path)


def test_a_file_that_changes_meanwhile_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays())
    source = open_params(path)
    source.read(0)
    saved(tmp_path, arrays(timesteps=3))
    with pytest.raises(InputError, match="was changed since the encode began"):
        source.read(1)


def test_values_are_checked_and_repaired(tmp_path: Path) -> None:
    found = arrays()
    found["means3D"][2, 7, 1] = np.nan
    found["unnorm_rotations"][1, 3] = 0
    path = saved(tmp_path, found)
    source = open_params(path)
    with pytest.raises(InputError, match=r"timestep 2: 1 values of means3D\[0\].*Gaussian 7"):
        source.read(2)
    with pytest.raises(InputError, match="timestep 1: 1 quaternions"):
        source.read(1)
    mended, notes = open_params(path, InputPolicy(repair=True)).read(2)
    assert np.isfinite(mended.positions).all()
    assert notes[0].startswith("timestep 2 of params.npz: ")
    assert np.isnan(open_params(path, InputPolicy(keep_bits=True)).read(2)[0].positions).any()


def test_options_that_choose_files_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays())
    assert "--pattern" in refusal_of(path, pattern="*.npz")
    assert "--order-by" in refusal(path, order_by="name")
    other = saved(tmp_path, arrays(), name="b.npz")
    with pytest.raises(InputError, match="is a sequence: name it alone"):
        open_frames([path, other])


def refusal_of(path: Path, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        open_frames([path], **options)
    return str(caught.value)


def test_the_output_is_never_the_input(tmp_path: Path) -> None:
    path = saved(tmp_path, arrays())
    with pytest.raises(InputError, match="is one of the frames"):
        encode_sequence(path, path, force=True)
