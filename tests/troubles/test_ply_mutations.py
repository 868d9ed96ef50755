"""Whatever bytes a PLY holds, reading it gives a frame or an InputError, in memory bounded by its size."""

from __future__ import annotations

import contextlib
import random
import tracemalloc
from pathlib import Path

import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.ply import InputPolicy, peek_header, read_ply
from tests.troubles.situations import ball, write
from tests.troubles.test_ply_headers import ascii_of, with_lists

POLICIES = (
    InputPolicy(),
    InputPolicy(drop_extra=True, repair=True, bake_filter=True),
    InputPolicy(drop_extra=True, keep_bits=True),
)
TOKENS = [
    *(
        b"-1",
        b"0",
        b"1",
        b"99999999",
        b"9223372036854775808",
        b"9" * 30,
        b"1e9",
        b"nan",
        b"",
        b"\x00",
        b"\xff\xfe",
    ),
    *(
        b"list",
        b"property",
        b"element",
        b"vertex",
        b"float",
        b"double",
        b"uchar",
        b"int",
        b"ascii",
        b"comment",
    ),
    *(
        b"binary_big_endian",
        b"end_header\n",
        b"\r",
        b"\n",
        b"ply\n",
        b"scale_2",
        b"f_rest_0",
        b"filter_3D",
        b"red",
    ),
    b"property list int double x\n",
    b"element face 4000000000\nproperty list uint double a\n",
]


def mutated(data: bytes, rng: random.Random) -> bytes:
    """A few changes: words of the header replaced, removed, put in; bytes changed; the end cut off."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        head = max(out.find(b"end_header"), 1) + 12
        at = rng.randrange(min(head, len(out)) if rng.random() < 0.4 else len(out)) if out else 0
        kind = rng.randrange(6)
        if kind <= 2:
            end = next((i for i in range(at, min(at + 30, len(out))) if out[i] in b" \n\r"), at)
            out[at:end] = rng.choice(TOKENS)
        elif kind == 3 and out:
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 4:
            del out[at : at + rng.randrange(1, 200)]
        else:
            out[at:at] = out[at : at + rng.randrange(1, 60)]
    return bytes(out)


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("originals")
    paths = [write(folder / "a.ply", ball(12, 1)), with_lists(folder / "b.ply", "<", "among")]
    paths.append(with_lists(folder / "c.ply", "", "before"))
    return [*(path.read_bytes() for path in paths), ascii_of(ball(9))]


@pytest.mark.parametrize("seed", range(4))
def test_mutated_plys_are_read_or_refused(tmp_path: Path, originals: list[bytes], seed: int) -> None:
    rng = random.Random(seed)
    path = tmp_path / "frame.ply"
    read, messages = 0, []
    for _ in range(150):
        path.write_bytes(mutated(rng.choice(originals), rng))
        for policy in POLICIES:
            try:
                peek_header(path, policy)
                read_ply(path, policy)
                read += 1
            except InputError as error:
                messages.append(str(error))
    # the mutations are not so wild that nothing is left to read
    assert read > 10
    assert all(line.startswith(f"{path}: ") and line.isprintable() for line in messages)


def test_memory_is_bounded_by_the_size_of_the_file(tmp_path: Path, originals: list[bytes]) -> None:
    path = tmp_path / "frame.ply"
    rng = random.Random(99)
    tracemalloc.start()
    for _ in range(40):
        data = mutated(rng.choice(originals), rng)
        path.write_bytes(data.replace(b"element vertex 12", b"element vertex 400000000"))
        with contextlib.suppress(InputError):
            read_ply(path, POLICIES[1])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4_000_000
