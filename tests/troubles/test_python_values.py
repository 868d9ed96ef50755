"""What Python users pass by habit is taken for what it means, or refused by an InputError before any work."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import (
    Bound,
    EncoderOptions,
    GaussianCloud,
    InputError,
    decode_sequence,
    encode_sequence,
    probe,
)
from dfcgs_codec.array_types import Float32
from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder, Profile
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from lab.options import encoder_options
from lab.small_clouds import FIELDS, drifting, make_cloud
from tests.helpers import write_frames

FRAMES = drifting(make_cloud(30, 1), 3)
QUICK = encoder_options(qp=27, motion="off", balance=False)
RATE = "a frame rate such as 30, 29.97"


@pytest.fixture(autouse=True)
def messages_as_written() -> None:
    """These tests read messages as a Python user does."""


@pytest.fixture(scope="module")
def coded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """FRAMES as a list gives them."""
    path = tmp_path_factory.mktemp("coded") / "a.dgs"
    encode_sequence(FRAMES, path, QUICK)
    return path.read_bytes()


# --- options ------------------------------------------------------------------------------------------

TAKEN: list[tuple[str, Any, Any]] = [
    ("frame_rate", 29.97, Fraction(2997, 100)),
    ("frame_rate", 30000 / 1001, Fraction(30000, 1001)),
    ("frame_rate", "30", Fraction(30)),
    ("frame_rate", "30000/1001", Fraction(30000, 1001)),
    ("frame_rate", np.float32(25), Fraction(25)),
    ("frame_rate", np.int64(24), Fraction(24)),
    ("frame_rate", Decimal("23.976"), Fraction(2997, 125)),
    ("bounds", {"position": 0.001}, (Bound("position", 0.001),)),
    ("bounds", [("alpha", 1), Bound("sh", 0.1)], (Bound("alpha", 1.0), Bound("sh", 0.1))),
    ("bounds", Bound("scale", np.float32(0.5)), (Bound("scale", 0.5),)),
    ("bounds", None, ()),
    ("qp", np.int64(20), 20.0),
    ("qp", np.array(20.5), 20.5),
    ("qp", None, None),
    ("quality", "high", 42.0),
    ("quality", "LOW", 32.0),
    ("quality", np.float32(40), 40.0),
    ("quality", "lossless", math.inf),
    ("gof_size", np.uint8(9), 9),
    ("gof_size", 9.0, 9),
    ("gof_size", "auto", None),
    ("jobs", np.int32(2), 2),
    ("order", "input", OutputOrder.INPUT),
    ("order", "FREE", OutputOrder.FREE),
    ("motion", "off", MotionMode.OFF),
    ("intra", "ply", IntraKind.PLY),
    ("profile", "paper", Profile.PAPER),
    ("refinement", "auto", RefinementMode.AUTO),
    ("balance", np.bool_(False), False),
]

REFUSED: list[tuple[str, Any, str]] = [
    ("frame_rate", "fast", RATE),
    ("frame_rate", "30/0", RATE),
    ("frame_rate", None, RATE),
    ("frame_rate", float("nan"), RATE),
    ("frame_rate", (30000, 1001), RATE),
    ("frame_rate", 0, "frame_rate 0: above 0"),
    ("frame_rate", True, RATE),
    ("bounds", "position=0.001", 'a mapping such as {"position": 0.001}'),
    ("bounds", 0.001, 'a mapping such as {"position": 0.001}'),
    ("bounds", {"position": "0.001"}, "Bound.value: found '0.001' (str), expected a number above 0"),
    ("bounds", {"position": float("nan")}, "a bound is a number above 0"),
    ("bounds", {"color": 0.1}, "known are position"),
    ("bounds", {0: 0.1}, "known are position"),
    ("qp", "28", "a number, or None"),
    ("qp", "high", 'a quality has its own option: quality="high"'),
    ("quality", "best", 'a number or one of "low", "medium", "high", "transparent", "lossless"'),
    ("quality", None, "found None (NoneType)"),
    ("quality", True, "found True (bool)"),
    ("quality", 99, "quality 99: 15 to 70 dB, or lossless, was expected"),
    ("qp", True, "found True (bool)"),
    ("qp", [28], "found [28] (list)"),
    ("qp", np.array([28]), "found array([28]) (ndarray)"),
    ("qp", 99, "qp 99.0: 0 to 51 was expected"),
    ("qp", 10**400, "a number"),
    ("gof_size", "30", 'a whole number, or "auto" or None'),
    ("gof_size", 30.5, "a whole number"),
    ("gof_size", 0, "gof_size 0: auto, or 1 to"),
    ("jobs", 0, "jobs 0: 1 or more"),
    ("jobs", "all", "None: all cores"),
    ("control_spacing", 70.5, "a whole number"),
    ("latent_step", "1", "a number"),
    ("order", "inptu", 'one of "free", "sequence", "input"'),
    ("order", 2, 'one of "free", "sequence", "input"'),
    ("order", IntraKind.PLY, 'one of "free", "sequence", "input"'),
    ("motion", None, 'one of "auto", "off", "only"'),
    ("motion", False, 'one of "auto", "off", "only"'),
    ("intra", "lossless", 'one of "ply", "coded"'),
    ("balance", "off", "True or False"),
    ("exact", 0, "True or False"),
    ("keep_unseen", None, "True or False"),
    ("model_id", 1, "a text or None"),
]


@pytest.mark.parametrize(("name", "given", "held"), TAKEN)
def test_options_are_taken(name: str, given: Any, held: Any) -> None:
    options = encoder_options(**{name: given})
    found = getattr(options if hasattr(options, name) else options.tuning, name)
    assert found == held
    assert type(found) is type(held)


@pytest.mark.parametrize(("name", "given", "expected"), REFUSED)
def test_options_are_refused(name: str, given: Any, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        encoder_options(**{name: given})
    assert expected in str(caught.value)
    assert name in str(caught.value) or name == "bounds"
    assert "--" not in str(caught.value)


def test_jobs_of_none_are_all_cores() -> None:
    assert EncoderOptions(jobs=None).jobs >= 1


def test_options_given_in_words_code_the_same(tmp_path: Path) -> None:
    words = encoder_options(qp=27, order="input", motion="off", frame_rate="29.97", bounds={"sh": 0.1})
    members = encoder_options(
        qp=27,
        order=OutputOrder.INPUT,
        motion=MotionMode.OFF,
        frame_rate=Fraction(2997, 100),
        bounds=(Bound("sh", 0.1),),
    )
    assert words == members
    assert replace(words, qp=20).order is OutputOrder.INPUT
    for name, options in (("a.dgs", words), ("b.dgs", members)):
        encode_sequence(FRAMES, tmp_path / name, options)
    assert (tmp_path / "a.dgs").read_bytes() == (tmp_path / "b.dgs").read_bytes()


# --- frames -------------------------------------------------------------------------------------------


def one_buffer() -> Iterator[GaussianCloud]:
    """As a simulation does it: every frame in the same arrays."""
    arrays = {name: getattr(FRAMES[0], name).copy() for name in FIELDS}
    for frame in FRAMES:
        for name, array in arrays.items():
            array[:] = getattr(frame, name)
        yield GaussianCloud(**arrays)


KINDS: dict[str, Callable[[Path], Any]] = {
    "tuple": lambda folder: tuple(FRAMES),
    "generator": lambda folder: (frame for frame in FRAMES),
    "generator of one buffer": lambda folder: one_buffer(),
    "chained": lambda folder: itertools.chain(FRAMES[:1], FRAMES[1:]),
    "values of a dict": lambda folder: dict(enumerate(FRAMES)).values(),
    "bytes of a path": lambda folder: bytes(write_frames(folder / "frames", FRAMES)),
    "a list of files": lambda folder: list(write_frames(folder / "frames", FRAMES).iterdir()),
    "files of a glob": lambda folder: write_frames(folder / "frames", FRAMES).glob("*.ply"),
    "a glob": lambda folder: f"{write_frames(folder / 'frames', FRAMES)}/*.ply",
    "text": lambda folder: str(write_frames(folder / "frames", FRAMES)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_taken(kind: str, tmp_path: Path, coded: bytes) -> None:
    encode_sequence(KINDS[kind](tmp_path), bytes(tmp_path / "a.dgs"), QUICK)
    assert (tmp_path / "a.dgs").read_bytes() == coded


def test_one_cloud_is_a_sequence_of_one_frame(tmp_path: Path) -> None:
    assert len(encode_sequence(FRAMES[0], tmp_path / "a.dgs").frames) == 1


class Source:
    """Frames of one's own, with a mistake."""

    def __init__(self, numbers: list[int], count: int) -> None:
        self.numbers, self.headers = numbers, [None] * count

    def read(self, index: int) -> None:
        raise AssertionError("nothing is read")


NO_FRAMES: list[tuple[Any, str]] = [
    (None, "frames: found None (NoneType), expected a folder of PLY files"),
    (5, "frames: found 5 (int)"),
    ("", "frames: found '' (str)"),
    ("a\0b", "expected a folder of PLY files"),
    ({0: FRAMES[0]}, "(dict), expected"),
    ({name: getattr(FRAMES[0], name) for name in FIELDS}, "(dict), expected"),
    (set(FRAMES), "(set), expected"),
    (object(), "expected a folder"),
    ([], "no frames"),
    (iter([]), "no frames"),
    ([None], "frame 0: a NoneType, expected a GaussianCloud"),
    ([FRAMES[0], FRAMES[1].positions], "frame 1: a ndarray, expected a GaussianCloud"),
    ([[FRAMES[0]]], "frame 0: a list"),
    ([FRAMES[0], "frame_0001.ply"], "a GaussianCloud and a file (frame_0001.ply)"),
    (["frame_0000.ply", ""], "frame 1: found '' (str)"),
    ([vars(FRAMES[0])], "frame 0: a dict"),
    (FRAMES[0].positions, "frame 0: a ndarray"),
    ([replace(FRAMES[0], opacities=FRAMES[0].opacities * np.nan)], "frame 0: opacities"),
    (Source([0, 1], 3), "2 numbers and 3 headers"),
    (Source([1, 0], 2), "do not ascend"),
    (Source([-1, 0], 2), "do not ascend"),
]


@pytest.mark.parametrize(("frames", "expected"), NO_FRAMES)
def test_frames_are_refused(frames: Any, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        encode_sequence(frames, tmp_path / "a.dgs")
    assert expected in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_decoded_frames_are_not_clouds_yet(tmp_path: Path) -> None:
    encode_sequence(FRAMES, tmp_path / "a.dgs")
    with pytest.raises(InputError, match=r"DecodedFrame.*cloud\(\)"):
        encode_sequence(decode_sequence(tmp_path / "a.dgs"), tmp_path / "b.dgs")
    report = encode_sequence((f.cloud() for f in decode_sequence(tmp_path / "a.dgs")), tmp_path / "b.dgs")
    assert len(report.frames) == 3


OTHERS: list[tuple[dict[str, Any], str]] = [
    ({"target": None}, "target: found None (NoneType), expected the path of a file"),
    ({"target": io.BytesIO()}, "target: found"),
    ({"target": ""}, "target: found '' (str)"),
    ({"options": {"qp": 20}}, "options: found {'qp': 20} (dict), expected EncoderOptions(...)"),
    ({"force": "no"}, "force: found 'no' (str), expected True or False"),
    ({"progress": 1}, "progress: found 1 (int), expected a function (done, total)"),
]


@pytest.mark.parametrize(("others", "expected"), OTHERS)
def test_other_arguments_are_refused(others: dict[str, Any], expected: str, tmp_path: Path) -> None:
    (tmp_path / "a.dgs").write_bytes(b"mine")
    with pytest.raises(InputError) as caught:
        encode_sequence(**{"frames": FRAMES, "target": tmp_path / "a.dgs"} | others)
    assert expected in str(caught.value)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"mine"]


# --- arrays -------------------------------------------------------------------------------------------


class Tensor:
    """What a framework keeps in main memory."""

    def __init__(self, array: Float32, error: Exception | None = None) -> None:
        self._array, self._error = array, error

    def __array__(self, dtype: Any = None, copy: Any = None) -> Float32:
        if self._error:
            raise self._error
        return self._array


def spread(array: Float32) -> Float32:
    wide = np.zeros((2 * len(array), *array.shape[1:]), np.float32)
    wide[::2] = array
    return wide[::2]


ARRAYS: dict[str, Callable[[Float32], Any]] = {
    "big-endian": lambda array: array.astype(">f4"),
    "columns first": np.asfortranarray,
    "every second row": spread,
    "backwards": lambda array: array[::-1].copy()[::-1],
    "tensor": Tensor,
    "nothing masked": np.ma.masked_array,
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_arrays_are_taken(kind: str, tmp_path: Path, coded: bytes) -> None:
    cloud = GaussianCloud(**{name: ARRAYS[kind](getattr(FRAMES[0], name)) for name in FIELDS})
    encode_sequence([cloud, *FRAMES[1:]], tmp_path / "a.dgs", QUICK)
    assert (tmp_path / "a.dgs").read_bytes() == coded
    assert all(type(getattr(cloud, name)) is np.ndarray for name in FIELDS)


NO_ARRAYS: list[tuple[Any, str]] = [
    (None, "found a NoneType, expected a numpy array"),
    (1.0, "expected a numpy array"),
    ("text", "expected a numpy array"),
    ([[0, 0, 0], [1]], "a list that is no array"),
    (np.zeros((30, 3), np.int64), "found int64 (30, 3)"),
    (np.zeros((30, 3), np.float16), "found float16 (30, 3)"),
    (np.zeros((30, 3), object), "found object (30, 3)"),
    (np.zeros((29, 3), np.float32), "found float32 (29, 3)"),
    (np.zeros((3, 30), np.float32), "found float32 (3, 30)"),
    (np.zeros(90, np.float32), "found float32 (90,)"),
    (Tensor(FRAMES[0].scales, RuntimeError("use tensor.detach()")), "use tensor.detach()"),
    (Tensor(FRAMES[0].scales, TypeError("use tensor.cpu()")), "use tensor.cpu()"),
    (np.ma.masked_array(FRAMES[0].scales, mask=FRAMES[0].scales > -4), "masked values"),
]


@pytest.mark.parametrize(("array", "expected"), NO_ARRAYS)
def test_arrays_are_refused(array: Any, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        replace(FRAMES[0], scales=array)
    assert str(caught.value).startswith("GaussianCloud.scales: ")
    assert expected in str(caught.value)


# --- decoding -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stream") / "a.dgs"
    encode_sequence(FRAMES, path)
    return path


@pytest.mark.parametrize(
    "of", [str, bytes, Path, lambda path: io.BytesIO(path.read_bytes()), lambda path: path.open("rb")]
)
def test_a_file_is_a_path_or_open(of: Callable[[Path], Any], stream: Path) -> None:
    file = of(stream)
    for _ in range(2):
        assert [frame.index for frame in decode_sequence(file)] == [0, 1, 2]
    if hasattr(file, "close"):
        assert not file.closed
        file.close()


def test_numbers_of_numpy_choose_frames(stream: Path) -> None:
    frames = decode_sequence(stream, np.int64(1), np.uint8(2))
    assert [frame.index for frame in frames] == [1]
    assert [frame.index for frame in decode_sequence(stream, 2, 99)] == [2]
    assert list(decode_sequence(stream, 3)) == []


NO_FILES: list[tuple[dict[str, Any], str]] = [
    ({"path": None}, "path: found None (NoneType), expected the path of a .dgs file"),
    ({"path": 3}, "path: found 3 (int)"),
    ({"path": ""}, "path: found '' (str)"),
    ({"path": io.StringIO("text")}, "open as text"),
    ({"start": -1}, "start: found -1 (int), expected a whole number from 0"),
    ({"start": 0.5}, "start: found 0.5 (float)"),
    ({"start": None}, "start: found None"),
    ({"start": "0"}, "start: found '0' (str)"),
    ({"stop": -1}, "stop: found -1 (int)"),
    ({"stop": True}, "stop: found True (bool)"),
    ({"check": "no"}, "check: found 'no' (str), expected True or False"),
]


@pytest.mark.parametrize(("arguments", "expected"), NO_FILES)
def test_what_cannot_be_decoded_is_refused_at_once(
    arguments: dict[str, Any], expected: str, stream: Path
) -> None:
    with pytest.raises(InputError) as caught:
        decode_sequence(**{"path": stream} | arguments)
    assert expected in str(caught.value)


def test_the_bytes_of_a_file_are_no_path(stream: Path) -> None:
    with pytest.raises(InputError, match=r"io\.BytesIO"):
        decode_sequence(stream.read_bytes())


def test_probe_takes_any_path(stream: Path) -> None:
    assert probe(bytes(stream)).num_bytes == probe(str(stream)).num_bytes == stream.stat().st_size
    with pytest.raises(InputError, match=r"path: found 5 \(int\), expected the path of a \.dgs file"):
        probe(5)  # type: ignore[arg-type]
