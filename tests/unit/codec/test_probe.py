from __future__ import annotations

import json
from pathlib import Path

import pytest

from dfcgs_codec import EncoderOptions, probe
from dfcgs_codec.bitstream.constants import OutputOrder
from dfcgs_codec.errors import BitstreamError, TruncatedBitstream
from lab.chunks import Chunk, join_chunks, split_chunks
from lab.small_clouds import all_changing, drifting, make_cloud, still
from tests.helpers import encode

KEYS = {
    "bitstream_version",
    "profile",
    "level",
    "sh_degree",
    "output_order",
    "num_frames",
    "frame_rate",
    "unit_exponents",
    "model_id",
    "encoder_info",
    "num_bytes",
    "ply_bytes",
    "compression_ratio",
    "bits_per_gaussian",
    "bytes_by_frame_type",
    "bytes_by_chunk_type",
    "bytes_by_attribute",
    "frames",
}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """I P skip | I P, of 50 Gaussians."""
    path = tmp_path_factory.mktemp("probe") / "a.dgs"
    moving = all_changing(make_cloud(50, 1), 4)
    encode([moving[0], moving[1], moving[1], moving[2], moving[3]], path, EncoderOptions(gof_size=3))
    return path


def test_frames(path: Path) -> None:
    info = probe(path)
    assert [f.frame_type for f in info.frames] == ["I", "P", "skip", "I", "P"]
    assert [f.frame_index for f in info.frames] == [0, 1, 2, 3, 4]
    assert {f.num_gaussians for f in info.frames} == {50}
    assert info.num_gaussians == 250


def test_all_bytes_are_accounted_for(path: Path) -> None:
    info = probe(path)
    size = path.stat().st_size
    assert info.num_bytes == size
    assert sum(info.chunk_bytes.values()) + 8 == size
    assert sum(info.bytes_by("attribute").values()) == size
    assert info.bytes_by("attribute")["HEADERS"] < 550
    frames = sum(info.chunk_bytes[name] for name in ("INTRA_FRAME", "INTER_FRAME", "RESIDUAL"))
    assert sum(info.bytes_by("frame_type").values()) == frames
    assert [offset for _, _, offset, _ in info.chunks] == sorted(offset for _, _, offset, _ in info.chunks)


def test_attributes_of_frames(path: Path) -> None:
    frames = probe(path).frames
    names = ["POSITION", "SCALE", "ROTATION", "OPACITY", "SH_DC", "SH_1"]
    assert sorted(frames[0].attribute_bytes) == sorted([*names, "COVER", "POSITION_BITS"])
    assert list(frames[1].attribute_bytes) == [n for n in names if n in frames[1].attribute_bytes]
    assert "POSITION" in frames[1].attribute_bytes
    assert frames[2].attribute_bytes == {}
    for frame in frames:
        assert sum(frame.attribute_bytes.values()) < frame.num_bytes


def test_the_permutation_is_listed(tmp_path: Path) -> None:
    encode(drifting(make_cloud(50), 2), tmp_path / "a.dgs", EncoderOptions(order=OutputOrder.INPUT))
    assert probe(tmp_path / "a.dgs").frames[0].attribute_bytes["OUTPUT_ORDER"] > 0


def test_json_has_the_specs_names(path: Path) -> None:
    values = json.loads(json.dumps(probe(path).as_dict()))
    assert set(values) == KEYS
    assert values["num_frames"] == 5
    assert values["ply_bytes"] == 250 * 4 * (14 + 9 + 3)
    assert values["compression_ratio"] == pytest.approx(values["ply_bytes"] / values["num_bytes"], rel=1e-3)
    assert values["bits_per_gaussian"] == pytest.approx(8 * values["num_bytes"] / 250, rel=1e-3)
    assert "quality=37dB qp=" in values["encoder_info"]
    assert values["frame_rate"] == [30, 1]


def test_nothing_is_entropy_decoded(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a stream was opened")

    monkeypatch.setattr("dfcgs_codec.entropy.coder.RangeReader.__init__", refuse)
    assert len(probe(path).frames) == 5


def test_every_prefix_is_truncated(path: Path, tmp_path: Path) -> None:
    data = path.read_bytes()
    for length in range(0, len(data), 7):
        (tmp_path / "cut.dgs").write_bytes(data[:length])
        with pytest.raises(TruncatedBitstream):
            probe(tmp_path / "cut.dgs")


def test_damaged_headers_are_refused_or_listed(tmp_path: Path) -> None:
    encode(still(make_cloud(2), 2), tmp_path / "a.dgs")
    data = (tmp_path / "a.dgs").read_bytes()
    listed = 0
    for position in range(len(data)):
        wrong = bytearray(data)
        wrong[position] ^= 0xFF
        (tmp_path / "b.dgs").write_bytes(wrong)
        try:
            json.dumps(probe(tmp_path / "b.dgs").as_dict())
            listed += 1
        except BitstreamError:
            pass
    assert 0 < listed < len(data)


def test_a_file_without_frames_is_no_crash(path: Path, tmp_path: Path) -> None:
    header: Chunk = split_chunks(path.read_bytes())[0]
    (tmp_path / "empty.dgs").write_bytes(join_chunks([header]))
    try:
        info = probe(tmp_path / "empty.dgs")
    except BitstreamError:
        return
    json.dumps(info.as_dict())
