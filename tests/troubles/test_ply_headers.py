"""PLYs as they are written in the wild: what is read, what is refused and in which words."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec.errors import InputError
from dfcgs_codec.ply import InputPolicy, display_comments, peek_header, read_ply, said_once, write_ply
from lab.small_clouds import make_cloud, same_cloud
from tests.troubles.situations import ball, encode, moved, run, sequence, write

BOM = b"\xef\xbb\xbf"
DROP = InputPolicy(drop_extra=True)


def changed(data: bytes, *changes: tuple[bytes, bytes]) -> bytes:
    """The file with its header changed."""
    end = data.index(b"end_header")
    head, body = data[:end], data[end:]
    for old, new in changes:
        assert old in head
        head = head.replace(old, new)
    return head + body


def newlines(data: bytes, newline: bytes) -> bytes:
    end = data.index(b"end_header\n") + len(b"end_header\n")
    return data[:end].replace(b"\n", newline) + data[end:]


def ascii_of(columns: dict[str, np.ndarray], *, row: int = 1, **words: str) -> bytes:
    """The frame as text; `words` replace what stands in row `row`."""
    rows = [[f"{v:.9g}" for v in values] for values in zip(*columns.values(), strict=True)]
    for name, word in words.items():
        rows[row][list(columns).index(name)] = word
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    lines += [f"property float {name}" for name in columns] + ["end_header"]
    return "\n".join([*lines, *(" ".join(r) for r in rows), ""]).encode()


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    return write(tmp_path / "frame_0000.ply", ball(20))


# --- headers that are read ----------------------------------------------------------------------------

READ: dict[str, Callable[[bytes], bytes]] = {
    "CRLF": lambda d: newlines(d, b"\r\n"),
    "CR": lambda d: newlines(d, b"\r"),
    "BOM": lambda d: BOM + d,
    "BOM and CRLF": lambda d: BOM + newlines(d, b"\r\n"),
    "spaces at the ends of lines": lambda d: newlines(d, b"  \t\n"),
    "tabs": lambda d: changed(d, (b"property float", b"\tproperty\tfloat")),
    "empty lines": lambda d: changed(d, (b"element", b"\n\nelement")),
    "long comments": lambda d: changed(d, (b"element", b"comment " + 90000 * b"x" + b"\nelement")),
    "thousands of comments": lambda d: changed(d, (b"element", 9000 * b"comment camera 1\n" + b"element")),
    "Latin-1": lambda d: changed(d, (b"element", b"comment Gr\xf6\xdfe\nelement")),
    "UTF-8": lambda d: changed(d, (b"element", "comment Größe, 雪\nobj_info 雪\nelement".encode())),
    "'end_header' in a comment": lambda d: changed(d, (b"element", b"comment end_heade\nelement")).replace(
        b"end_heade\n", b"the end_header\n", 1
    ),
    "float32": lambda d: changed(d, (b"property float ", b"property float32 ")),
    "no face": lambda d: d.replace(
        b"end_header\n", b"element face 0\nproperty list uchar int vertex_indices\nend_header\n"
    ),
    "a newline at the end": lambda d: d + b"\r\n",
}


@pytest.mark.parametrize("name", READ)
def test_what_is_read(plain: Path, name: str) -> None:
    expected = read_ply(plain)[0]
    plain.write_bytes(READ[name](plain.read_bytes()))
    header = peek_header(plain)
    assert (header.num_gaussians, header.sh_degree, header.dropped, header.remarks) == (20, 0, (), ())
    assert same_cloud(read_ply(plain)[0], expected)


def test_a_binary_body_after_cr_may_begin_with_the_byte_of_lf(tmp_path: Path) -> None:
    columns = ball(5)
    columns["x"] = np.frombuffer(b"\n\x00\x80?" * 5, "<f4")
    path = write(tmp_path / "a.ply", columns)
    expected = path.read_bytes()[-5 * 4 * 17 :]
    assert expected.startswith(b"\n")
    path.write_bytes(newlines(path.read_bytes(), b"\r"))
    assert np.array_equal(read_ply(path)[0].positions[:, 0], columns["x"])


def test_a_frame_without_gaussians_is_a_frame(tmp_path: Path) -> None:
    empty = {name: values[:0] for name, values in ball(3, sh_degree=2).items()}
    path = write(tmp_path / "a.ply", empty)
    assert (peek_header(path).num_gaussians, peek_header(path).sh_degree) == (0, 2)
    cloud, notes = read_ply(path)
    assert (cloud.num_gaussians, cloud.sh_rest.shape, notes) == (0, (0, 3, 8), [])
    path.write_bytes(path.read_bytes().rstrip(b"\n"))
    assert read_ply(path)[0].num_gaussians == 0
    write_ply(path, cloud)
    assert peek_header(path).sh_degree == 2


# --- text bodies --------------------------------------------------------------------------------------

NOT_A_NUMBER = ["nan", "NaN", "-nan(ind)", "nan(0x8)", "1.#QNAN", "-1.#IND", "-1.#IND00", "1.#SNAN"]
INFINITE = ["inf", "-Infinity", "1.#INF", "-1.#INF00", "+1.#INF"]


@pytest.mark.parametrize("word", NOT_A_NUMBER + INFINITE)
def test_nan_and_infinity_in_all_spellings(tmp_path: Path, word: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ascii_of(ball(4), y=word))
    kind = "1 NaN" if word in NOT_A_NUMBER else "1 -inf" if "-" in word else "1 inf"
    with pytest.raises(InputError, match=rf"\({kind}\), first 'y' of Gaussian 1; --repair"):
        read_ply(path)
    value = read_ply(path, InputPolicy(keep_bits=True))[0].positions[1, 1]
    assert not np.isfinite(value)


WRONG_TEXT = {
    "0,5": "'0,5' of Gaussian 1 is no number: a decimal comma",
    "abc": "'abc' of Gaussian 1 is no number",
    "1 2": "Gaussian 1 has 18 values, expected 17",
    "": "Gaussian 1 has 16 values, expected 17",
    "\x1b[31m": r"'\x1b[31m' of Gaussian 1 is no number",
}


@pytest.mark.parametrize("word", WRONG_TEXT)
def test_text_that_is_no_number(tmp_path: Path, word: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ascii_of(ball(4), y=word))
    with pytest.raises(InputError) as caught:
        read_ply(path)
    assert WRONG_TEXT[word] in str(caught.value)


@pytest.mark.parametrize("newline", [b"\n", b"\r\n", b"\r"])
def test_text_with_all_line_ends(tmp_path: Path, newline: bytes) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ascii_of(ball(9)).replace(b"\n", newline))
    assert np.array_equal(read_ply(path)[0].positions[:, 2], ball(9)["z"])
    path.write_bytes(path.read_bytes() + b"1 2 3" + newline)
    with pytest.raises(InputError, match="1 more lines than the header announces"):
        read_ply(path)
    assert read_ply(path, DROP)[1] == ["a.ply: left out: 1 lines after the last row"]


# --- refusals -----------------------------------------------------------------------------------------


def lfs(_: bytes) -> bytes:
    return b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n"


REFUSED: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda d: b"", "it is empty"),
    "UTF-16": (lambda d: "ply\n".encode("utf-16"), "UTF-16"),
    "git-lfs": (lfs, "git-lfs pointer"),
    "HTML": (lambda d: b"\n<!DOCTYPE html>", "web page"),
    "gzip": (lambda d: b"\x1f\x8b\x08" + d, "gzip"),
    "zeros": (lambda d: bytes(9000), "begins with zeros"),
    "PNG": (lambda d: b"\x89PNG\r\n\x1a\n", "PNG"),
    "capitals": (lambda d: d.replace(b"ply", b"PLY", 1), "capital letters"),
    "two to the 63 rows": (lambda d: changed(d, (b"vertex 20", b"vertex 9223372036854775808")), "ends "),
    "many digits": (lambda d: changed(d, (b"vertex 20", b"vertex " + b"9" * 5000)), "has the count '999"),
    "a negative count": (lambda d: changed(d, (b"vertex 20", b"vertex -1")), "has the count '-1'"),
    "a count in words": (lambda d: changed(d, (b"vertex 20", b"vertex 2e1")), "has the count '2e1'"),
    "no format": (lambda d: changed(d, (b"format binary_little_endian 1.0\n", b"")), "no 'format' line"),
    "another format": (lambda d: changed(d, (b"binary_little", b"binary_middle")), "binary_middle_endian"),
    "another type": (lambda d: changed(d, (b"property float x", b"property half x")), "'property half x'"),
    "escape sequences": (lambda d: changed(d, (b"property float x", b"prop\x1b[2J x")), r"'prop\x1b[2J x'"),
    "twice a property": (lambda d: changed(d, (b"float nx", b"float opacity")), "'opacity' is there 2 times"),
    "twice the vertices": (
        lambda d: d.replace(b"end_header", b"element vertex 0\nproperty float x\nend_header"),
        "'element vertex' is there 2 times",
    ),
    "rows without properties": (
        lambda d: d.replace(b"end_header", b"element thing 99999999999\nend_header"),
        "element thing has 99999999999 rows without properties",
    ),
    "1000 bytes short": (lambda d: d[:-1000], "ends 1000 bytes before the end of the 20 Gaussians"),
    "a header alone": (lambda d: d[: d.index(b"end_header")], "no end_header line"),
    "one byte more": (lambda d: d + b"x", "1 bytes more than the header announces"),
    "LF made CRLF": (lambda d: d.replace(b"\n", b"\r\n") + b"12345", "more than the header announces"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_by_header_and_size(plain: Path, name: str) -> None:
    make, words = REFUSED[name]
    plain.write_bytes(make(plain.read_bytes()))
    for look in (peek_header, read_ply):
        with pytest.raises(InputError) as caught:
            look(plain)
        assert words in str(caught.value)
        assert str(caught.value).startswith(f"{plain}: ")
        assert "\n" not in str(caught.value)


def test_folders_pipes_and_missing_files_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.ply")
    (tmp_path / "folder.ply").mkdir()
    for name, words in (("pipe", "a pipe or device"), ("folder", "a folder"), ("none", "No such file")):
        with pytest.raises(InputError, match=words):
            peek_header(tmp_path / f"{name}.ply")


def test_a_file_shortened_while_it_is_read_is_refused(plain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = plain.stat().st_size
    monkeypatch.setattr("dfcgs_codec.ply.read._extra_bytes", lambda *_: os.truncate(plain, size - 100) or 0)
    write(plain, ball(2000))
    size = plain.stat().st_size
    with pytest.raises(InputError, match="ends 100 bytes before the end of the 2000 Gaussians"):
        read_ply(plain)


def test_the_last_frame_is_looked_at_before_the_first_is_coded(tmp_path: Path) -> None:
    frames = sequence(tmp_path / "frames", 4)
    last = frames / "frame_0003.ply"
    for columns, tail, words in (
        (ball(200), -1000, "frame_0003.ply: truncated"),
        (ball(200) | {"red": np.zeros(200, "u1")}, None, "frame_0003.ply: properties that the codec"),
    ):
        write(last, columns)
        last.write_bytes(last.read_bytes()[:tail])
        outcome = run("encode", frames, tmp_path / "a.dgs", "--jobs", "1")
        assert outcome.code == 1
        assert words in outcome.err


def test_300_headers_are_read_in_no_time(plain: Path) -> None:
    start = time.process_time()
    for _ in range(300):
        peek_header(plain)
    assert time.process_time() - start < 0.5


# --- what the codec does not keep ---------------------------------------------------------------------

EXTRAS = "element extrinsic 16\nproperty float extrinsic\nelement size 2\nproperty uint size"
TAIL = bytes(16 * 4 + 2 * 4)


def test_extra_elements_are_refused_or_left_out_by_name(tmp_path: Path) -> None:
    for layout in ({"after": EXTRAS, "tail": TAIL}, {"before": EXTRAS}):
        path = write(tmp_path / "a.ply", ball(30), **layout)
        if "before" in layout:
            data = path.read_bytes()
            path.write_bytes(data.replace(b"end_header\n", b"end_header\n" + TAIL))
        for look in (peek_header, read_ply):
            with pytest.raises(InputError, match="does not keep: extrinsic, size; --drop-extra"):
                look(path)
        assert peek_header(path, DROP).dropped == ("element extrinsic", "element size")
        assert np.array_equal(read_ply(path, DROP)[0].scales[:, 1], ball(30)["scale_1"])


def with_lists(path: Path, byte_order: str, place: str) -> Path:
    """Lists of 0 to 2 numbers to each Gaussian, after x or in an element before; '' for ascii."""
    columns = ball(30)
    order = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[byte_order]
    fields = [f"property float {name}" for name in columns]
    seen = ["property list uchar short seen"]
    head = ["ply", f"format {order} 1.0"]
    head += ["element views 30", *seen] if place == "before" else []
    head += ["element vertex 30", *fields[:1], *(seen if place == "among" else []), *fields[1:]]
    lists, rows = [], []
    for i, row in enumerate(zip(*columns.values(), strict=True)):
        if byte_order:
            lists.append(struct.pack(f"{byte_order}B{i % 3}h", i % 3, *range(i % 3)))
            rows.append([struct.pack(f"{byte_order}f", v) for v in row])
        else:
            lists.append(b" ".join(b"%d" % v for v in (i % 3, *range(i % 3))) + b" ")
            rows.append([b"%.9g " % v for v in row])
    if place == "among":
        rows = [[row[0], found, *row[1:]] for row, found in zip(rows, lists, strict=True)]
    else:
        rows = [[found] for found in lists] + rows
    end = b"" if byte_order else b"\n"
    body = b"".join(b"".join(row) + end for row in rows)
    path.write_bytes("\n".join([*head, "end_header", ""]).encode() + body)
    return path


@pytest.mark.parametrize("place", ["among", "before"])
@pytest.mark.parametrize("byte_order", ["<", ">", ""])
def test_lists_are_refused_or_left_out_by_name(tmp_path: Path, byte_order: str, place: str) -> None:
    path = with_lists(tmp_path / "a.ply", byte_order, place)
    path.write_bytes(path.read_bytes().replace(b"element v", "comment 雪\nelement v".encode(), 1))
    name = "seen" if place == "among" else "views"
    with pytest.raises(InputError, match=f"does not keep: {name}; --drop-extra"):
        peek_header(path)
    cloud, _ = read_ply(path, DROP)
    assert np.allclose(cloud.positions[:, 1], ball(30)["y"], rtol=1e-6)
    path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(InputError, match="truncated"):
        read_ply(path, DROP)


def test_what_is_left_out_is_said_once(tmp_path: Path) -> None:
    features = {f"semantic_{i}": np.zeros(200, "f4") for i in range(512)}
    for t in range(3):
        write(tmp_path / "frames" / f"frame_{t:04d}.ply", moved(ball(200), 0.02 * t) | features)
    refused = encode(tmp_path / "frames", tmp_path / "a.dgs")
    assert refused.code == 1
    assert "semantic_0, semantic_1, semantic_2, ..., semantic_511 (512 in all); --drop-extra" in refused.err
    done = encode(tmp_path / "frames", tmp_path / "a.dgs", "--drop-extra")
    assert done.code == 0
    assert done.err.count("left out: semantic_0,") == 1
    assert "frame_0000.ply and 2 more: left out: semantic_0" in done.err


def test_bytes_after_the_last_row_are_left_out_if_allowed(plain: Path) -> None:
    plain.write_bytes(plain.read_bytes() + b"12345")
    header = peek_header(plain, DROP)
    assert header.dropped == ("bytes after the last row",)
    assert said_once([plain.name], [header]) == ["frame_0000.ply: left out: 5 bytes after the last row"]
    assert read_ply(plain, DROP)[0].num_gaussians == 20


# --- comments -----------------------------------------------------------------------------------------

KEPT = [
    b"SplatRenderMode: mip",
    b"splatrendermode: 2dgs",
    b"antialiased 1",
    b"train_flags antialiasing",
    b"Vertical axis: y",
    b"Vertical Axis: z",
    b"up axis: -y",
    b"coordinate_system: RDF",
    b"color_space: sRGB",
    b"rasterize_mode=antialiased",
]
NOT_KEPT = [
    b"Generated by nerfstudio",
    b"SH degree: 3",
    b"Gr\xf6\xdfe in Metern",
    b"camera 17",
    b"",
    b"supplied",
]


@pytest.mark.parametrize("newline", [b"\n", b"\r\n", b"\r"])
def test_comments_are_kept_as_they_are(tmp_path: Path, newline: bytes) -> None:
    lines = [b"comment " + line for line in (*KEPT, *NOT_KEPT)]
    path = write(tmp_path / "a.ply", ball(3), comments=lines, newline=newline)
    assert peek_header(path).comments == (*KEPT, *NOT_KEPT)
    assert display_comments(peek_header(path).comments) == tuple(KEPT)


def test_many_and_long_comments_are_not_kept() -> None:
    assert display_comments([b"gamma " + bytes(300)]) == ()
    assert display_comments([b"gamma %d" % i for i in range(50)]) == tuple(
        b"gamma %d" % i for i in range(34, 50)
    )


def test_comments_are_written_back(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, make_cloud(3), comments=[*KEPT, b"\xf6\x00", b"two\nelement vertex 9\r\nlines"])
    assert peek_header(path).comments == (*KEPT, b"\xf6\x00", b"two element vertex 9 lines")
    assert same_cloud(read_ply(path)[0], make_cloud(3))
    assert path.read_bytes().startswith(
        b"ply\nformat binary_little_endian 1.0\ncomment SplatRenderMode: mip\n"
    )
