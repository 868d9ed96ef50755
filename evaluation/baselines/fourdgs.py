"""fourdgs (`.4dgs`), temporal model keyframe-delta: bins by identity, differences from frame to frame.

The package's API is given true identities: those of `ids.npz` in the frames folder (arrays ids_0000,
ids_0001, ... int64 (N,)), else the index where N is constant. They are renumbered along the Morton order of
their first appearance, so that its streams compress well; zstd level 19 in place of its default deflate.

A setting is one of its profiles, whose bounds follow from the median scale of the scene, and the distance of
keyframes. What its model loses beside the bounds:

    sh_rest    not stored by keyframe-delta: content with SH is refused
    sh_dc      as RGB clipped to 0 .. 1
    opacities  as alpha, uniform bins; 0 and 1 come back as the ends of ALPHA_RANGE

Decoded Gaussians come in the order of the new identities.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.gaussians import GaussianCloud
from evaluation.baselines.colour import alpha_of, logit_of, rgb_of, sh_dc_of
from evaluation.baselines.frames import identities, pinned, read_frames, write_frames
from evaluation.baselines.method import Method, SequenceFacts

REQUIREMENT = "fourdgs==0.6.0"
_ZSTD = "zstandard==0.25.0"
_WRAPPER = 1
_FILE = "sequence.4dgs"
_LEVEL = 19
#: seconds per frame on the file's clock
_PERIOD = 1 / 30
#: the temporal extent must be finite; so long that opacity never fades
_EXTENT = 1e6


def _module(name: str) -> Any:
    pinned(REQUIREMENT)
    return importlib.import_module(f"fourdgs.{name}")


def _version() -> str:
    return f"{pinned(REQUIREMENT)} {pinned(_ZSTD)} wrapper {_WRAPPER}"


def _accepts(facts: SequenceFacts) -> str | None:
    if facts.sh_degree:
        return "keyframe-delta drops SH"
    return None


def _renumbered(clouds: list[GaussianCloud], ids: list[Int64]) -> list[Int64]:
    """Identities as 0, 1, 2 ... in Morton order of the frame in which each appears first."""
    numbers: dict[int, int] = {}
    morton_order = _module("quantization").morton_order
    for cloud, names in zip(clouds, ids, strict=True):
        for name in names[morton_order(cloud.positions)].tolist():
            numbers.setdefault(name, len(numbers))
    return [np.array([numbers[name] for name in names.tolist()], np.int64) for names in ids]


def _gaussian_set(cloud: GaussianCloud, time: float, duration: float) -> Any:
    n = cloud.num_gaussians
    wide = cloud.rotations.astype(np.float64)
    return _module("model").GaussianSet(
        positions=cloud.positions,
        scales=np.exp(cloud.scales),
        rotations=wide[:, [1, 2, 3, 0]] / np.linalg.norm(wide, axis=1, keepdims=True),
        colors=np.concatenate([rgb_of(cloud.sh_dc), alpha_of(cloud.opacities)[:, None]], axis=1),
        motions=np.zeros((n, 3), np.float32),
        mu_t=np.full(n, time),
        sigma_t=np.full(n, _EXTENT),
        win_lo=np.zeros(n),
        win_hi=np.full(n, duration),
    )


def _encode(frames: Path, target: Path, setting: str) -> None:
    profile, gof = setting.split("_gof")
    writer, clouds = _module("keyframe_delta_writer"), list(read_frames(frames))
    duration, samples = len(clouds) * _PERIOD, []
    for index, names in enumerate(_renumbered(clouds, identities(frames, clouds))):
        order, time = np.argsort(names), index * _PERIOD
        gaussians = _gaussian_set(clouds[index].take(order), time, duration)
        samples.append(writer.Sample(time, names[order], gaussians))
    data = _module("keyframe_delta_file").write_sequence(
        samples,
        duration,
        kd=writer.KeyframeDeltaOptions(keyframe_every=int(gof)),
        profile=profile,
        codec=_module("serialization").CODEC_ZSTD,
        level=_LEVEL,
    )
    (target / _FILE).write_bytes(data)


def _cloud(values: dict[str, Any]) -> GaussianCloud:
    n = len(values["ids"])
    return GaussianCloud(
        positions=values["centers"].astype(np.float32),
        rotations=values["rotations"][:, [3, 0, 1, 2]].astype(np.float32),
        scales=np.log(values["scales"]).astype(np.float32),
        opacities=logit_of(values["opacity"]),
        sh_dc=sh_dc_of(values["rgb"]),
        sh_rest=np.zeros((n, 3, 0), np.float32),
    )


def _clouds(data: bytes) -> Iterator[GaussianCloud]:
    library = _module("keyframe_delta_file")
    sequence = library.decode_streamed(data)
    for chunk in sequence.chunks:
        yield _cloud(library.reconstruct_at(chunk.state, sequence.grids, chunk.t0))


def _decode(target: Path, frames: Path) -> None:
    write_frames(frames, _clouds((target / _FILE).read_bytes()))


_SETTINGS = ("fine_gof10", "default_gof10", "coarse_gof10", "fine_gof60", "coarse_gof60")
METHOD = Method("fourdgs", "fourdgs keyframe-delta", _SETTINGS, _version, _accepts, _encode, _decode)
