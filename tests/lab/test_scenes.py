"""The generator of moving scenes: determinism, identity, rotations, the variants' statistics, stress."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from plyfile import PlyData
from scipy.spatial import cKDTree

from dfcgs_codec.array_types import Bool, Float32, Float64
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.ply import read_ply
from lab.meshes.gltf import load_asset
from lab.meshes.posing import pose_vertices
from lab.scenes import (
    MOTIONS,
    STRESS,
    VARIANTS,
    SceneOptions,
    animated_sequence,
    permuted_with_ids,
    semi_tracked_with_ids,
    stress_sequence,
    trained_sequence,
)
from lab.scenes import rotations as rot
from lab.scenes.__main__ import main
from lab.scenes.animated import select_clip
from lab.scenes.fields import scene_size
from lab.scenes.stress import blob_cloud, coincident

ROOT = Path(__file__).resolve().parents[2]
FOX = ROOT / "assets" / "Fox.glb"
PLAYBOT = ROOT / "assets" / "playbot_31k_sh2.ply"
NAMES = [f.name for f in dataclasses.fields(GaussianCloud)]
Sequence = list[GaussianCloud]


def same(a: GaussianCloud, b: GaussianCloud, names: list[str] = NAMES) -> bool:
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in names)


def identical(a: Float32, b: Float32) -> Bool:
    """(N,) which rows are bit-identical."""
    return (a == b).reshape(len(a), -1).all(axis=1)


def nearest_rotation(before: Float64, after: Float64) -> Float64:
    """(n, 4) rotation of each group of points (n, k, 3), by Kabsch: independent of the generator's way."""
    a = before - before.mean(axis=1, keepdims=True)
    b = after - after.mean(axis=1, keepdims=True)
    u, _, vt = np.linalg.svd(np.einsum("nki,nkj->nij", b, a))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return rot.from_matrices(u @ vt)


def turn_between(a: GaussianCloud, b: GaussianCloud) -> Float64:
    """(N, 4) the rotation that takes each Gaussian of `a` to `b`."""
    return rot.multiply(rot.normalised(b.rotations), rot.conjugate(rot.normalised(a.rotations)))


@pytest.fixture(scope="module")
def fox() -> Sequence:
    return list(animated_sequence(FOX, SceneOptions(8, 4000, 2, seed=3), clip="Walk"))


@pytest.fixture(scope="module")
def still() -> Sequence:
    return [blob_cloud(8000, 1, seed=5)] * 6


class TestAnimated:
    def test_only_positions_and_rotations_change(self, fox: Sequence) -> None:
        for a, b in pairwise(fox):
            assert same(a, b, ["scales", "opacities", "sh_dc", "sh_rest"])
            assert not identical(a.positions, b.positions).any()
        assert fox[0].num_gaussians == 4000
        assert fox[0].sh_degree == 2

    def test_deterministic_by_seed(self, fox: Sequence) -> None:
        again = list(animated_sequence(FOX, SceneOptions(8, 4000, 2, seed=3), clip="Walk"))
        assert all(same(a, b) for a, b in zip(fox, again, strict=True))
        other = next(animated_sequence(FOX, SceneOptions(1, 4000, 2, seed=4), clip="Walk"))
        assert not np.array_equal(other.positions, fox[0].positions)

    def test_rotations_follow_nearby_points(self, fox: Sequence) -> None:
        first, last = fox[0], fox[-1]
        near = cKDTree(first.positions).query(first.positions, 8)[1]
        seen = nearest_rotation(
            first.positions.astype(np.float64)[near], last.positions.astype(np.float64)[near]
        )
        turn = turn_between(first, last)
        assert np.percentile(rot.angles(turn, [1.0, 0.0, 0.0, 0.0]), 75) > 0.2
        assert np.median(rot.angles(turn, seen)) < 0.06

    def test_signs_are_continuous(self, fox: Sequence) -> None:
        for a, b in pairwise(fox):
            assert (np.einsum("ni,ni->n", a.rotations, b.rotations) >= 0.0).all()

    def test_appearance_is_plausible(self, fox: Sequence) -> None:
        frame = fox[0]
        color = 0.5 + 0.2821 * frame.sh_dc
        assert (color > -0.01).all()
        assert (color < 1.01).all()
        assert color.std(axis=0).min() > 0.1
        assert (np.median(frame.scales[:, 2] - frame.scales[:, :2].mean(axis=1))) < -1.5
        assert 0.05 < frame.sh_rest.std() < 0.2
        assert frame.opacities.std() > 1.0

    def test_unknown_clip_names_those_there_are(self) -> None:
        with pytest.raises(InputError, match="Survey, Walk, Run"):
            select_clip(load_asset(FOX), "Fly")


class TestGltf:
    """A triangle with morph target, animated in every way, against values worked out by hand."""

    @pytest.fixture
    def path(self, tmp_path: Path) -> Path:
        times = np.array([0.0, 2.0], "<f4")
        half = np.sqrt(0.5)
        blobs = {
            "position": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4"),
            "times": times,
            # CUBICSPLINE: in-tangent, value, out-tangent of both keys; tangents 0, so smoothstep
            "translation": np.array(
                [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [4, 0, 0], [0, 0, 0]], "<f4"
            ),
            "rotation": np.array([[0, 0, 0, 1], [0, 0, -half, -half]], "<f4"),
            "weights": np.array([0.0, 1.0], "<f4"),
            "rows": np.array([2], "<u2"),
            "offset": np.array([[0, 0, 5]], "<f4"),
        }
        document = pygltflib.GLTF2(scene=0, scenes=[pygltflib.Scene(nodes=[0])])
        document.nodes = [pygltflib.Node(children=[1]), pygltflib.Node(mesh=0, translation=[0, 0, 1])]
        offset = 0
        for name, blob in blobs.items():
            size = blob.nbytes
            document.bufferViews.append(pygltflib.BufferView(buffer=0, byteOffset=offset, byteLength=size))
            offset += size + (-size) % 4
            kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[1 if blob.ndim == 1 else blob.shape[1]]
            component = 5123 if blob.dtype == "<u2" else 5126
            view = len(document.bufferViews) - 1
            document.accessors.append(
                pygltflib.Accessor(
                    bufferView=view, componentType=component, count=len(blob), type=kind, name=name
                )
            )
        sparse = pygltflib.Sparse(
            count=1,
            indices=pygltflib.AccessorSparseIndices(bufferView=5, componentType=5123),
            values=pygltflib.AccessorSparseValues(bufferView=6),
        )
        document.accessors.append(pygltflib.Accessor(componentType=5126, count=3, type="VEC3", sparse=sparse))
        attributes = pygltflib.Attributes(POSITION=0)
        primitive = pygltflib.Primitive(attributes=attributes, targets=[{"POSITION": 7}])
        document.meshes = [pygltflib.Mesh(primitives=[primitive], weights=[0.0])]
        samplers = [("CUBICSPLINE", 2), ("LINEAR", 3), ("STEP", 4)]
        targets = [(0, "translation"), (0, "rotation"), (1, "weights")]
        document.animations = [
            pygltflib.Animation(
                samplers=[
                    pygltflib.AnimationSampler(input=1, output=o, interpolation=i) for i, o in samplers
                ],
                channels=[
                    pygltflib.AnimationChannel(
                        sampler=k, target=pygltflib.AnimationChannelTarget(node=node, path=kind)
                    )
                    for k, (node, kind) in enumerate(targets)
                ],
            )
        ]
        document.buffers = [pygltflib.Buffer(byteLength=offset)]
        document.set_binary_blob(b"".join(b.tobytes() + b"\0" * (-b.nbytes % 4) for b in blobs.values()))
        path = tmp_path / "triangle.glb"
        document.save_binary(str(path))
        return path

    @pytest.mark.parametrize(
        ("time", "expected"),
        [
            (0.0, [[0, 0, 1], [1, 0, 1], [0, 1, 1]]),
            # smoothstep(1/4) = 5/32, and a quarter of the 90 degrees that the short way round is
            (0.5, [[0.625, 0, 1], [1.5488795, 0.3826834, 1], [0.2423166, 0.9238795, 1]]),
            (2.0, [[4, 0, 1], [4, 1, 1], [3, 0, 6]]),
        ],
    )
    def test_pose(self, path: Path, time: float, expected: list[list[float]]) -> None:
        asset = load_asset(path)
        assert pose_vertices(asset, asset.clips[0], time) == pytest.approx(np.array(expected), abs=1e-6)

    def test_unsupported_extension_is_refused(self, path: Path, tmp_path: Path) -> None:
        document = pygltflib.GLTF2().load(str(path))
        document.extensionsRequired = ["KHR_draco_mesh_compression"]
        document.save_binary(str(tmp_path / "draco.glb"))
        with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
            load_asset(tmp_path / "draco.glb")


class TestTrained:
    def test_part_is_rigid_and_background_identical(self) -> None:
        rest = read_ply(PLAYBOT)[0]
        frames = list(trained_sequence(rest, SceneOptions(5, fps=4.0, seed=1), "part"))
        assert same(frames[0], rest)
        moved = ~identical(frames[-1].positions, rest.positions)
        assert moved.mean() == pytest.approx(0.12, abs=0.001)
        for frame in frames[1:]:
            for name in NAMES:
                assert identical(getattr(frame, name), getattr(rest, name))[~moved].all()
            before = rest.positions[moved].astype(np.float64)
            after = frame.positions[moved].astype(np.float64)
            (turn,) = nearest_rotation(before[None], after[None])
            fitted = rot.rotate(turn, before - before.mean(axis=0)) + after.mean(axis=0)
            assert np.abs(fitted - after).max() < 1e-6 * scene_size(rest.positions)
            assert rot.angles(turn_between(rest, frame)[moved], turn).max() < 1e-5
            assert rot.angles(turn, [1.0, 0.0, 0.0, 0.0]) > 0.1

    @pytest.mark.parametrize("motion", ["sway", "bend", "twist"])
    def test_rotations_follow_nearby_points(self, motion: str) -> None:
        blob = blob_cloud(300, 0, seed=2)
        # six companions around each Gaussian; the deformation hardly varies over that distance
        offsets = 0.01 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        cloud = blob.take(np.repeat(np.arange(300), 7))
        cloud = dataclasses.replace(
            cloud, positions=(cloud.positions + np.tile(offsets, (300, 1))).astype(np.float32)
        )
        frames = list(trained_sequence(cloud, SceneOptions(2, seed=2, fps=1.4), motion))
        before, after = (f.positions.astype(np.float64).reshape(300, 7, 3) for f in frames)
        turn = turn_between(*frames)[::7]
        assert rot.angles(turn, [1.0, 0.0, 0.0, 0.0]).max() > 0.05
        assert np.percentile(rot.angles(turn, nearest_rotation(before, after)), 95) < 0.01

    @pytest.mark.parametrize("motion", MOTIONS)
    def test_deterministic_and_quaternion_lengths_kept(self, motion: str) -> None:
        cloud = blob_cloud(500, 0, seed=2)
        cloud = dataclasses.replace(cloud, rotations=cloud.rotations * np.float32(2.5))
        first, second = (list(trained_sequence(cloud, SceneOptions(4, seed=9), motion)) for _ in range(2))
        assert all(same(a, b) for a, b in zip(first, second, strict=True))
        assert np.linalg.norm(first[-1].rotations, axis=1) == pytest.approx(2.5, abs=1e-5)

    def test_reduction(self) -> None:
        rest = blob_cloud(500, 2, seed=2)
        frame = next(trained_sequence(rest, SceneOptions(1, 100, 1)))
        assert (frame.num_gaussians, frame.sh_degree) == (100, 1)
        with pytest.raises(InputError, match="SH degree 2"):
            next(trained_sequence(rest, SceneOptions(1, sh_degree=3)))


class TestVariants:
    # the coincident case has 200 k Gaussians a frame; it is tested below with fewer
    @pytest.mark.parametrize("name", [name for name in VARIANTS if name != "coincident"])
    def test_deterministic_finite_and_complete(self, name: str, fox: Sequence) -> None:
        first, second, other = (list(VARIANTS[name](fox, seed)) for seed in (1, 1, 2))
        assert len(first) == len(fox)
        assert all(same(a, b) for a, b in zip(first, second, strict=True))
        for frame in first:
            assert all(np.isfinite(getattr(frame, n)).all() for n in NAMES)
        if name not in ("smooth", "single", "static"):
            assert not all(same(a, b) for a, b in zip(first, other, strict=True))

    def test_smooth_is_the_clean_sequence(self, fox: Sequence) -> None:
        assert all(same(a, b) for a, b in zip(fox, VARIANTS["smooth"](fox, 1), strict=True))

    def test_noisy_statistics(self, still: Sequence) -> None:
        frames = list(VARIANTS["noisy"](still, 1))
        for a, b in pairwise(frames):
            kept = identical(a.positions, b.positions)
            step = np.linalg.norm((b.positions - a.positions)[~kept], axis=1) / scene_size(still[0].positions)
            assert same(a, b, ["sh_dc", "sh_rest"])
            assert identical(a.scales, b.scales).mean() == pytest.approx(0.98, abs=0.01)
            assert (a.opacities == b.opacities).mean() == pytest.approx(0.96, abs=0.01)
            assert kept.mean() == pytest.approx(0.35, abs=0.01)
            assert np.median(step) == pytest.approx(6.6e-4, rel=0.1)
            turned = rot.angles(a.rotations, b.rotations)
            assert np.median(turned) == pytest.approx(0.017, rel=0.1)
            assert turned.min() > 0.0

    def test_noisy_jitter_stays_bounded(self) -> None:
        clean = [blob_cloud(500, 0, seed=5)] * 100
        *_, last = VARIANTS["noisy"](clean, 1)
        wandered = np.linalg.norm(last.positions - clean[0].positions, axis=1)
        assert np.median(wandered) < 10 * 6.6e-4 * scene_size(clean[0].positions)

    def test_noisy_holds_what_the_clean_sequence_holds(self) -> None:
        rest = blob_cloud(2000, 0, seed=5)
        clean = list(trained_sequence(rest, SceneOptions(4, seed=1), "part"))
        for a, b in pairwise(VARIANTS["noisy"](clean, 1)):
            assert identical(a.positions, b.positions).mean() == pytest.approx(0.35, abs=0.001)

    def test_drift_changes_every_attribute_everywhere(self, still: Sequence) -> None:
        frames = list(VARIANTS["drift"](still, 1))
        for a, b in pairwise(frames):
            for name in NAMES:
                # a scalar may fall on the same float32 by chance
                assert identical(getattr(a, name), getattr(b, name)).mean() < 0.001
        change = np.linalg.norm(frames[-1].positions - frames[0].positions, axis=1)
        low, high = np.percentile(change, [5, 95])
        assert high > 4 * low
        near = cKDTree(still[0].positions).query(still[0].positions, 2)[1][:, 1]
        shift = (frames[-1].scales - frames[0].scales)[:, 0]
        assert np.corrcoef(shift, shift[near])[0, 1] > 0.7

    @pytest.mark.parametrize("source", ["fox", "still"])
    def test_semi_tracked_statistics(self, source: str, request: pytest.FixtureRequest) -> None:
        frames = list(semi_tracked_with_ids(request.getfixturevalue(source), 1))
        assert all(
            same(a, b) for (a, _), b in zip(frames, VARIANTS["semi"](request.getfixturevalue(source), 1))
        )
        for (a, ids_a), (b, ids_b) in pairwise(frames):
            _, in_a, in_b = np.intersect1d(ids_a, ids_b, assume_unique=True, return_indices=True)
            assert (np.diff(in_b[np.argsort(in_a)]) > 0).all(), "survivors keep their order"
            deaths, births = 1 - len(in_a) / len(ids_a), 1 - len(in_b) / len(ids_b)
            assert 0.002 < deaths < 0.009
            assert 0.002 < births < 0.009
            kept = np.stack([identical(getattr(a, n)[in_a], getattr(b, n)[in_b]) for n in NAMES])
            assert 0.895 <= kept.all(axis=0).mean() <= 0.935
            # what changes, changes in every attribute
            assert (kept.any(axis=0) == kept.all(axis=0)).mean() > 0.999

    def test_semi_tracked_refuses_varying_n(self, fox: Sequence) -> None:
        frames = [fox[0], fox[1].take(np.arange(100))]
        with pytest.raises(InputError, match="frame 1: 100 Gaussians"):
            list(VARIANTS["semi"](frames, 1))

    def test_permuted_is_semi_tracked_in_another_order(self, fox: Sequence) -> None:
        pairs = zip(semi_tracked_with_ids(fox, 1), permuted_with_ids(fox, 1), strict=True)
        for (a, ids_a), (b, ids_b) in pairs:
            assert not np.array_equal(ids_a, ids_b)
            assert same(a.take(np.argsort(ids_a)), b.take(np.argsort(ids_b)))
        plain = VARIANTS["permuted"](fox, 1)
        assert all(same(a, b) for (a, _), b in zip(permuted_with_ids(fox, 1), plain, strict=True))

    def test_untracked_has_no_correspondence_but_the_same_surface(self, fox: Sequence) -> None:
        frames = list(VARIANTS["untracked"](fox, 1))
        assert len({f.num_gaussians for f in frames}) > 4
        assert all(0.89 * 4000 < f.num_gaussians < 1.11 * 4000 for f in frames)
        for clean, frame in zip(fox, frames, strict=True):
            distance = cKDTree(clean.positions).query(frame.positions)[0]
            assert distance.min() > 0.0
            assert np.median(distance) < 2 * np.exp(np.median(clean.scales[:, :2]))


class TestStress:
    def frames(self, name: str, count: int = 8) -> Sequence:
        return list(stress_sequence(name, SceneOptions(count, 1000, 1, seed=1)))

    def test_outliers(self) -> None:
        radius = np.linalg.norm(self.frames("outliers")[3].positions, axis=1)
        assert (radius > 800 * 1.5).mean() == pytest.approx(0.01)

    def test_extreme_scales(self) -> None:
        scales = self.frames("extreme-scales")[3].scales
        assert (scales > 4).all(axis=1).sum() == 10
        assert (scales < -19).all(axis=1).sum() == 10

    def test_large_motion(self) -> None:
        for a, b in pairwise(self.frames("large-motion")):
            assert np.linalg.norm((b.positions - a.positions).mean(axis=0)) > 1.3 * scene_size(a.positions)

    def test_scene_cut(self) -> None:
        counts = [f.num_gaussians for f in self.frames("scene-cut")]
        assert counts == [1000] * 4 + [750] * 4

    @pytest.mark.parametrize("name", ["noisy", "drift", "untracked"])
    def test_variants_survive_a_cut(self, name: str) -> None:
        frames = list(VARIANTS[name](self.frames("scene-cut"), 0))
        assert len(frames) == 8
        assert frames[-1].num_gaussians < 850

    def test_sign_flips(self) -> None:
        flipped = self.frames("sign-flips")
        clean = list(trained_sequence(blob_cloud(1000, 1, 1), SceneOptions(8, 1000, 1, seed=1), "sway"))
        for a, b in zip(flipped, clean, strict=True):
            assert identical(np.abs(a.rotations), np.abs(b.rotations)).all()
            assert 0.4 < identical(a.rotations, -b.rotations).mean() < 0.6

    def test_coincident(self) -> None:
        (frame,) = coincident([blob_cloud(50, 0, 1)], 0, count=500)
        assert len(np.unique(frame.positions, axis=0)) == 1
        assert frame.num_gaussians == 500
        assert next(stress_sequence("coincident", SceneOptions(1, 10))).num_gaussians == 200_000

    def test_single_static_alternating(self) -> None:
        assert {f.num_gaussians for f in self.frames("single")} == {1}
        static = self.frames("static")
        assert all(same(static[0], f) for f in static)
        a, b, c, d = self.frames("alternating", 4)
        assert same(a, c)
        assert same(b, d)
        assert not identical(a.positions, b.positions).any()

    @pytest.mark.parametrize("name", [n for n in VARIANTS if n != "coincident"])
    @pytest.mark.parametrize("motion", MOTIONS)
    def test_one_gaussian_survives_everything(self, name: str, motion: str) -> None:
        clean = trained_sequence(blob_cloud(1, 0, 1), SceneOptions(5), motion)
        frames = list(VARIANTS[name](clean, 0))
        assert len(frames) == 5
        assert all(np.isfinite(getattr(f, n)).all() for f in frames for n in NAMES)


class TestCommandLine:
    def test_writes_standard_files(self, tmp_path: Path, fox: Sequence) -> None:
        out = tmp_path / "fox"
        options = [
            "--frames",
            "2",
            "--gaussians",
            "4000",
            "--sh-degree",
            "2",
            "--seed",
            "3",
            "--clip",
            "Walk",
        ]
        assert main([str(FOX), str(out), *options]) == 0
        assert [p.name for p in sorted(out.iterdir())] == ["frame_0000.ply", "frame_0001.ply"]
        vertex = PlyData.read(str(out / "frame_0000.ply"))["vertex"].data
        names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
        names += [f"f_rest_{i}" for i in range(24)] + ["opacity", "scale_0", "scale_1", "scale_2"]
        assert list(vertex.dtype.names) == [*names, "rot_0", "rot_1", "rot_2", "rot_3"]
        assert {vertex.dtype[n] for n in names} == {np.dtype("<f4")}
        # channel first: f_rest_8 is the first higher coefficient of green
        assert np.array_equal(vertex["f_rest_8"], fox[0].sh_rest[:, 1, 0])
        assert same(read_ply(out / "frame_0001.ply")[0], fox[1])

    def test_variant_of_a_stress_scene(self, tmp_path: Path) -> None:
        options = ["--frames", "3", "--gaussians", "100", "--variant", "noisy"]
        assert main(["outliers", str(tmp_path / "out"), *options]) == 0
        assert read_ply(tmp_path / "out" / "frame_0002.ply")[0].num_gaussians == 100

    @pytest.mark.parametrize("scene", ["missing.glb", "no-such-case", __file__])
    def test_bad_scene_is_one_line(
        self, scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert main([scene, str(tmp_path / "out")]) == 1
        assert capsys.readouterr().err.count("\n") == 1

    def test_frames_are_not_mixed(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        command = [next(iter(STRESS)), str(tmp_path / "out"), "--frames", "1", "--gaussians", "10"]
        assert main(command) == 0
        assert main(command) == 1
        assert "already holds frames" in capsys.readouterr().err
