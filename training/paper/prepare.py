"""Sequences of the training group -> prepared GoFs, with I-frames as the codec decodes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dfcgs_codec.array_types import Float16, Float64, Int64
from dfcgs_codec.bitstream.constants import MAX_DECAY_EXPONENT, Attribute, Profile
from dfcgs_codec.bitstream.motion_header import SpreadHeader
from dfcgs_codec.codec.motion.compensation import ControlSource
from dfcgs_codec.codec.paper.latent_motion import LatentControl
from dfcgs_codec.codec.state.planes import SH_BANDS, FrameState
from dfcgs_codec.encoder.frame.frame_coding import coded_intra
from dfcgs_codec.encoder.frame.targets import Planes, Targets
from dfcgs_codec.encoder.matching.identity import Members
from dfcgs_codec.encoder.plan.allocation import Placing
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.encoder.plan.tuning import EncoderTuning
from dfcgs_codec.errors import InputError
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.sequence import MemorySource
from lab.assets import find_asset
from lab.scenes.catalogue import Scene, group, scene
from training.paper.gof import NUM_FRAMES, Gof, camera_row, normalisation

#: frame steps, and QPs of I-frames, in turn; the number of GoFs of a sequence is that of the steps
STRIDES = (1, -1, 2, 1, -2, 1, 3, -1)
QPS = (28.0, 22.0, 34.0)
#: a GoF has a random share of the Gaussians, at least this
MIN_SHARE = 0.4
VIEW_ANGLES = ((20.0, 10.0), (110.0, 30.0), (200.0, 20.0), (290.0, 40.0))
#: of the evaluation's 640 x 480 images
IMAGE_SHARE = 0.3


@dataclass(frozen=True)
class Layout:
    """Gaussians of a GoF at most, how many there are to a control point (M), and how many it moves (K)."""

    max_gaussians: int = 24_000
    control_spacing: int = 70
    num_neighbours: int = 30


@dataclass(frozen=True)
class GofChoice:
    """Which frames and Gaussians of a sequence make a GoF."""

    first: int
    stride: int
    qp: float
    share: float
    seed: int


def training_scenes(names: list[str] | None = None) -> list[Scene]:
    """The scenes of the training group, or those of them that are named; InputError for any other."""
    chosen = group("training") if names is None else [scene(name) for name in names]
    others = {s.asset for s in [*group("evaluation"), *group("long"), *group("captures")]}
    for one in chosen:
        if one.group != "training":
            raise InputError(f"{one.name} is of group {one.group!r}; only 'training' is trained on")
        # characters may be shared between clips, but never between the groups
        assert one.asset not in others, f"{one.asset} is an asset of evaluation scenes"
    return chosen


def choices(num_frames: int, seed: int) -> list[GofChoice]:
    """The GoFs of a sequence of so many frames."""
    rng = np.random.default_rng(seed)
    found = []
    for index, stride in enumerate(STRIDES):
        span = (NUM_FRAMES - 1) * abs(stride)
        if span >= num_frames:
            continue
        first = int(rng.integers(num_frames - span))
        first = first if stride > 0 else first + span
        share = float(rng.uniform(MIN_SHARE, 1.0))
        found.append(GofChoice(first, stride, QPS[index % len(QPS)], share, seed + index))
    return found


def _common(
    frames: list[tuple[GaussianCloud, Int64 | None]], choice: GofChoice, max_gaussians: int
) -> list[GaussianCloud]:
    """The frames' Gaussians that all of them have, in the same order, a random share of them."""
    ids = [np.arange(cloud.num_gaussians) if ids is None else ids for cloud, ids in frames]
    common = ids[0]
    for some in ids[1:]:
        common = np.intersect1d(common, some)
    rng = np.random.default_rng(choice.seed)
    count = min(max_gaussians, max(1, int(choice.share * len(common))))
    kept = np.sort(rng.choice(common, count, replace=False))
    clouds = []
    for (cloud, _), some in zip(frames, ids, strict=True):
        by_id = np.argsort(some)
        clouds.append(cloud.take(by_id[np.searchsorted(some, kept, sorter=by_id)]))
    return clouds


def _decoded_first(plan: SequencePlan, planes: Planes) -> tuple[FrameState, Members]:
    """The I-frame as a decoder has it, and which rows of the input it is made of."""
    placing, quantisation = Placing.of(planes, plan), plan.quantisation
    order, grid = placing.intra.order(planes[Attribute.POSITION])
    members = Members(order, placing.names.take(order))
    zero_bin = plan.options.tuning.intra_zero_bin
    wanted = placing.intra.target(members.target(planes), (order, grid), quantisation, zero_bin)
    wanted = replace(wanted, keeps_names=True)
    return coded_intra(plan.writer(0), wanted, plan.control).state.frame, members


def prepare_gof(
    clouds: list[GaussianCloud],
    qp: float,
    up: str,
    num_views: int = len(VIEW_ANGLES),
    layout: Layout | None = None,
) -> Gof:
    """A GoF of clouds whose index is identity."""
    layout = layout or Layout()
    # steps as the profile has them: those of MAIN are balanced for the scene
    options = EncoderOptions(
        qp=qp, gof_size=1, profile=Profile.PAPER, tuning=EncoderTuning(control_spacing=layout.control_spacing)
    )
    plan = plan_sequence(MemorySource(clouds), options)
    targets = Targets(plan.header.unit_exponents)
    planes = targets.planes(clouds[0])
    state, members = _decoded_first(plan, planes)
    later = [members.target(targets.planes(cloud)) for cloud in clouds[1:]]
    first = {attribute: plane.wide() for attribute, plane in state.planes.items()}
    frames = [first, *later]
    control = LatentControl(ControlSource(state.planes[Attribute.POSITION], plan.control))
    centre, extent_log2 = normalisation(first[Attribute.POSITION])
    # distances in units of the normalised scene: networks do not see how large a scene unit is
    exponent = plan.control.shift - extent_log2
    exponent = int(np.clip(exponent, -MAX_DECAY_EXPONENT, MAX_DECAY_EXPONENT))
    spreading = control.spreading(SpreadHeader(layout.num_neighbours, exponent))
    units = plan.header.unit_exponents
    images, cameras = _pictures(clouds, up, num_views)
    colours = [first[a] for a in (Attribute.SH_DC, *SH_BANDS) if a in first]
    return Gof(
        positions=np.stack([f[Attribute.POSITION] for f in frames]).astype(np.int32),
        rotations=np.stack([f[Attribute.ROTATION] for f in frames]).astype(np.int32),
        scales=first[Attribute.SCALE].astype(np.int32),
        opacities=first[Attribute.OPACITY].astype(np.int32),
        colours=np.concatenate(colours, axis=1).astype(np.int32),
        units=np.array([units.position, units.scale, units.opacity, units.color], np.int64),
        centre=centre,
        extent_log2=np.array(extent_log2),
        control=control.points[1],
        neighbours=spreading.gaussians,
        weights=spreading.weights,
        images=images,
        cameras=cameras,
    )


def _pictures(clouds: list[GaussianCloud], up: str, num_views: int) -> tuple[Float16, Float64]:
    """Images of the P-frames and their cameras, as `Gof` has them; without views no renderer is needed."""
    if not num_views:
        return np.zeros((0, len(clouds) - 1, 1, 1, 3), np.float16), np.zeros((0, 20))
    from lab.render import render
    from lab.views import central_box, framing_camera

    box = central_box(clouds[0])
    images, rows = [], []
    for angles in VIEW_ANGLES[:num_views]:
        camera = framing_camera(box, angles, up)
        sizes = {name: getattr(camera, name) * IMAGE_SHARE for name in ("fx", "fy", "cx", "cy")}
        shape = {name: int(getattr(camera, name) * IMAGE_SHARE) for name in ("width", "height")}
        camera = replace(camera, **sizes, **shape)
        images.append([render(cloud, camera).colour for cloud in clouds[1:]])
        rows.append(camera_row(camera))
    return np.array(images, np.float16), np.array(rows)


def prepare(folder: Path, names: list[str] | None = None, layout: Layout | None = None) -> Iterator[Path]:
    """Prepare what is not there yet; `<scene>.<number>.npz`."""
    layout = layout or Layout()
    folder.mkdir(parents=True, exist_ok=True)
    for one in training_scenes(names):
        frames: list[tuple[GaussianCloud, Int64 | None]] = []
        for index, choice in enumerate(choices(one.num_frames, one.seed)):
            path = folder / f"{one.name}.{index}.npz"
            if not path.exists():
                frames = frames or list(one.frames_with_ids(find_asset(one.asset)))
                picked = [frames[choice.first + i * choice.stride] for i in range(NUM_FRAMES)]
                clouds = _common(picked, choice, layout.max_gaussians)
                prepare_gof(clouds, choice.qp, one.up, layout=layout).save(path)
            yield path
