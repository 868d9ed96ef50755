"""What becomes visible within a GoF is as good as in an I-frame; what stays as it is costs nothing more."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import GaussianCloud, decode_sequence, encode_sequence
from lab.options import encoder_options
from lab.small_clouds import drifting, real_cloud

NUM_FRAMES = 4


def appearing(cloud: GaussianCloud, dimmed: tuple[float, ...], share: float = 0.5) -> list[GaussianCloud]:
    """The Gaussians on one side have less of opacity (logit), frame by frame."""
    x = cloud.positions[:, 0]
    some = x > np.quantile(x, 1 - share)
    return [replace(cloud, opacities=(cloud.opacities - less * some).astype(np.float32)) for less in dimmed]


def coded(frames: list[GaussianCloud], target: Path, **options: object) -> tuple[str, float]:
    """Kinds of frames, and error of colours in the last one, weighted by how much each shows."""
    report = encode_sequence(frames, target, encoder_options(qp=18, order="input", **options), force=True)
    *_, last = decode_sequence(target)
    shown = 1 / (1 + np.exp(-frames[-1].opacities.astype(np.float64)))
    size = np.exp(np.sort(frames[-1].scales, axis=1)[:, 1:].sum(axis=1))
    squares = ((last.cloud().sh_dc - frames[-1].sh_dc) ** 2).sum(axis=1)
    error = float(np.sqrt((shown**2 * size * squares).sum() / (shown**2 * size).sum()))
    return "".join(frame.kind[0] for frame in report.frames), error


DIMMED = [(12, 12, 3, 0), (12, 0, 0, 0), (9, 6, 3, 0), (12, 12, 12, 0)]
SHARES = [0.2, 0.5, 1.0]
#: those of `make test`; all others are slow
QUICK = [(DIMMED[0], 0.2), (DIMMED[1], 1.0), (DIMMED[2], 0.5)]


@pytest.mark.parametrize(
    ("dimmed", "share"),
    [
        pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow, id=str(case))
        for case in itertools.product(DIMMED, SHARES)
    ],
)
def test_what_appears_is_as_good_as_in_an_i_frame(
    dimmed: tuple[float, ...], share: float, tmp_path: Path
) -> None:
    frames = appearing(real_cloud(2000), dimmed, share)
    kinds, error = coded(frames, tmp_path / "a.dgs")
    _, still = coded(frames, tmp_path / "b.dgs", gof_size=1)
    assert error <= 1.25 * still
    assert kinds.startswith("I")


def test_who_vanishes_needs_no_i_frame(tmp_path: Path) -> None:
    kinds, _ = coded(appearing(real_cloud(2000), (0, 3, 6, 12)), tmp_path / "a.dgs")
    assert kinds.count("I") == 1


def test_who_moves_needs_no_i_frame(tmp_path: Path) -> None:
    kinds, _ = coded(drifting(real_cloud(2000), NUM_FRAMES), tmp_path / "a.dgs")
    assert kinds.count("I") == 1


def test_trembling_opacities_need_no_i_frame(tmp_path: Path) -> None:
    cloud, random = real_cloud(2000), np.random.default_rng(1)
    noise = [random.normal(0, 0.1, 2000).astype(np.float32) for _ in range(NUM_FRAMES)]
    kinds, _ = coded([replace(cloud, opacities=cloud.opacities + n) for n in noise], tmp_path / "a.dgs")
    assert kinds.count("I") == 1
