"""What is not done twice for a P-frame."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dfcgs_codec import EncoderOptions, decode_sequence, encode_sequence, probe
from dfcgs_codec.encoder import frame_coding, inter_coding
from dfcgs_codec.encoder.inter_coding import InterCoder
from lab.options import encoder_options
from tests.helpers import real_cloud, succeeding


def coder_that_finds(monkeypatch: pytest.MonkeyPatch, sizes: list[int]) -> InterCoder:
    """Its frames without motion have these sizes, one after the other."""
    rest = iter(sizes)
    monkeypatch.setattr(InterCoder, "_coded", lambda *_: SimpleNamespace(data=bytes(next(rest))))
    return InterCoder(SimpleNamespace(options=EncoderOptions(), quantisation=None))  # type: ignore[arg-type]


def test_motion_that_was_better_is_trusted_for_some_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    coder = coder_that_finds(monkeypatch, [11, 9])
    moved: Any = SimpleNamespace(data=bytes(10))
    found = [coder._better(None, moved) for _ in range(6)]  # type: ignore[arg-type]
    assert [len(frame.data) for frame in found] == [10, 10, 10, 10, 10, 9]


def test_motion_that_was_worse_is_tried_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    coder = coder_that_finds(monkeypatch, [9, 9, 11])
    moved: Any = SimpleNamespace(data=bytes(10))
    found = [coder._better(None, moved) for _ in range(3)]  # type: ignore[arg-type]
    assert [len(frame.data) for frame in found] == [9, 9, 10]


def test_a_new_gof_trusts_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    coder = coder_that_finds(monkeypatch, [11, 9])
    moved: Any = SimpleNamespace(data=bytes(10))
    assert len(coder._better(None, moved).data) == 10  # type: ignore[arg-type]
    coder.begin(None)
    assert len(coder._better(None, moved).data) == 9  # type: ignore[arg-type]


def test_births_are_coded_once_whatever_motion_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inter_coding, "_SURE_SHARE", 2.0)
    frames, coded = 0, 0
    code_frame, code_topology = inter_coding.code_inter_frame, frame_coding.code_topology

    def counted_frame(*args: Any) -> Any:
        nonlocal frames
        frames += args[-2] is not None or args[-1] is not None
        return code_frame(*args)

    def counted_topology(*args: Any) -> Any:
        nonlocal coded
        coded += 1
        return code_topology(*args)

    monkeypatch.setattr(inter_coding, "code_inter_frame", counted_frame)
    monkeypatch.setattr(frame_coding, "code_topology", counted_topology)
    path = tmp_path / "births.dgs"
    clouds = succeeding(real_cloud(600), 4)
    encode_sequence(clouds, path, encoder_options(control_spacing=20, jobs=1))
    assert coded == sum(frame.frame_type == "P" for frame in probe(path).frames) == 3
    assert frames > coded
    decoded = [frame.cloud().num_gaussians for frame in decode_sequence(path)]
    assert decoded == [cloud.num_gaussians for cloud in clouds]
