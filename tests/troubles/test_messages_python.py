"""From Python no message speaks of options of the command line; on the command line every one does."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dfcgs_codec
from dfcgs_codec import EncoderOptions, InputError, InputPolicy, encode_sequence, open_folder
from dfcgs_codec.cli import cli
from dfcgs_codec.gaussians import GaussianCloud
from dfcgs_codec.spelling import PYTHON, command_line, in_python
from lab.options import encoder_options
from lab.small_clouds import drifting, make_cloud
from tests.helpers import write_frames
from tests.troubles.situations import encode, sequence

SOURCES = Path(dfcgs_codec.__file__).parent
OPTION = re.compile(r"(?<![\w./-])--[a-z][a-z-]*[a-z]")


@pytest.fixture(autouse=True)
def messages_as_written() -> None:
    """These tests read messages as a Python user does."""


def strings(module: ast.Module) -> Iterator[str]:
    """Texts of a module that a user may get to read: all but docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(module)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.value


def mentioned() -> set[tuple[str, str]]:
    """(module, option) of every option in a text of the library."""
    found = set()
    for path in sorted(SOURCES.rglob("*.py")):
        name = path.relative_to(SOURCES).as_posix()
        if not name.startswith("cli/") and name != "spelling.py":
            for text in strings(ast.parse(path.read_text())):
                found |= {(name, option) for option in OPTION.findall(text)}
    return found


def options_of_commands() -> set[str]:
    commands = [cli.get_command(None, name) for name in cli.list_commands(None)]  # type: ignore[arg-type]
    return {name for command in commands if command for option in command.params for name in option.opts}


def names_in_python() -> set[str]:
    functions = [getattr(dfcgs_codec, name) for name in dfcgs_codec.__all__]
    names = set(dfcgs_codec.__all__)
    for function in functions:
        if dataclasses.is_dataclass(function):
            names |= {field.name for field in dataclasses.fields(function)}
        elif inspect.isfunction(function):
            names |= set(inspect.signature(function).parameters)
    return names


def test_every_option_mentioned_is_one_and_has_a_name_in_python() -> None:
    options, names = options_of_commands(), names_in_python()
    assert len(mentioned()) > 20
    for module, option in sorted(mentioned()):
        assert option in options, f"{module} speaks of {option}"
        said = re.findall(r"[A-Za-z_]{2,}", re.sub(r"\b(the|of|True|False)\b", "", in_python(option)))
        assert said, option
        assert set(said) <= names, f"{module}: {option} is {in_python(option)!r} in Python; see spelling.py"


def test_every_phrase_begins_with_an_option() -> None:
    assert {phrase.split()[0] for phrase in PYTHON} <= options_of_commands()


PHRASES = {
    "--qp 99: 0 to 51 was expected": "qp 99: 0 to 51 was expected",
    "choose coarser steps (a higher --qp or --bound)": "choose coarser steps (a higher qp or bounds)",
    "--quality 99: 15 to 70 dB": "quality 99: 15 to 70 dB",
    "--qp with --quality lossless; '--force'": "qp with quality=\"lossless\"; 'force=True'",
    "--fps 0, --gof-size 0.": "frame_rate 0, gof_size 0.",
    "--pattern 'a_*.ply' takes all, or --order-by name": (
        "open_folder(..., pattern='a_*.ply') takes all, or open_folder(..., order_by='name')"
    ),
    "choose with --pattern, or --order-by.": (
        "choose with the pattern of open_folder(), or the order_by of open_folder()."
    ),
    "/data/--force/take--repair/a --b": "/data/--force/take--repair/a --b",
    "no options -- none": "no options -- none",
}


@pytest.mark.parametrize("written", PHRASES)
def test_messages_are_put_into_pythons_words(written: str) -> None:
    error = InputError(written)
    assert str(error) == f"{error}" == PHRASES[written] == in_python(PHRASES[written])
    assert str(pickle.loads(pickle.dumps(error))) == PHRASES[written]
    with command_line():
        assert str(error) == str(pickle.loads(pickle.dumps(error))) == written
    assert str(error) == PHRASES[written]


def spoilt(**arrays: Any) -> list[GaussianCloud]:
    return [dataclasses.replace(frame, **arrays) for frame in drifting(make_cloud(20), 2)]


def gap(folder: Path) -> Path:
    write_frames(folder / "frames", drifting(make_cloud(20), 3))
    (folder / "frames" / "frame_0001.ply").unlink()
    return folder / "frames"


SITUATIONS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "a missing frame": (
        lambda folder: encode_sequence(gap(folder), folder / "a.dgs"),
        "open_folder(..., allow_gaps=True)",
    ),
    "a name taken": (
        lambda folder: [encode_sequence(spoilt(), folder / "a.dgs") for _ in range(2)],
        "force=True",
    ),
    "values that are not finite": (
        lambda folder: encode_sequence(
            write_frames(folder / "f", spoilt(opacities=np.full(20, np.nan, np.float32))), folder / "a.dgs"
        ),
        "open_folder(..., policy=InputPolicy(repair=True))",
    ),
    "a bound that cannot be kept": (
        lambda folder: encode_sequence(spoilt(), folder / "a.dgs", EncoderOptions(bounds={"rotation": 1e-9})),
        "bounds rotation: the tightest",
    ),
    "another profile": (lambda folder: encoder_options(profile="paper", motion="off"), 'profile="main"'),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_what_a_python_user_reads(name: str, tmp_path: Path) -> None:
    act, advice = SITUATIONS[name]
    with pytest.raises(InputError) as caught:
        act(tmp_path)
    assert advice in str(caught.value)
    assert "--" not in str(caught.value)


def test_the_advice_works(tmp_path: Path) -> None:
    frames = gap(tmp_path)
    cloud = make_cloud(20)
    write_frames(frames, [dataclasses.replace(cloud, opacities=np.full(20, np.nan, np.float32))])
    source = open_folder(frames, allow_gaps=True, policy=InputPolicy(repair=True))
    assert len(encode_sequence(source, tmp_path / "a.dgs").frames) == 2


def test_the_command_line_speaks_of_its_options(tmp_path: Path) -> None:
    frames = sequence(tmp_path / "frames", n=20)
    (frames / "frame_0001.ply").unlink()
    done = encode(frames, tmp_path / "a.dgs")
    assert done.code == 1
    assert "--allow-gaps encodes the others" in done.err
    done = encode(frames, tmp_path / "a.dgs", "--quality", "99")
    assert "--quality 99: 15 to 70 dB, or lossless, was expected" in done.err
