"""bitstream_spec.md against the code: constants, citations, worked example, and a decoder of its own.

`spec_decoder.py` is written from the text alone. Where its hashes differ from the package's, the text is
wrong or incomplete, or the code has changed without it.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import io
import json
import re
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from dfcgs_codec import (
    BitstreamError,
    CorruptBitstream,
    EncoderOptions,
    GaussianCloud,
    VerificationError,
    decode_sequence,
    encode_sequence,
)
from dfcgs_codec.bitstream import constants
from dfcgs_codec.bitstream.constants import (
    Attribute,
    ChunkType,
    IntraKind,
    OutputOrder,
    Precision,
    Profile,
    Tool,
)
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps, SortGrid
from dfcgs_codec.bitstream.io import ByteReader, ByteWriter
from dfcgs_codec.bitstream.motion_header import MotionHeader
from dfcgs_codec.bitstream.sequence_header import FrameNumbers, SequenceHeader, UnitExponents
from dfcgs_codec.codec.columns.magnitudes import log_of
from dfcgs_codec.codec.columns.side_information import (
    code_signed,
    code_tables,
    code_weights,
    histogram_models,
)
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.topology import TopologyGoal
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.residual.classes import BLOCK_LOG2, AttributeActivity, InterSymbols
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.frame import chunk_writer, frame_coding
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.intra.intra_plan import IntraTarget
from dfcgs_codec.encoder.paper.latent_coding import LatentCoder
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.encoder.plan.tuning import MotionMode, RefinementMode
from dfcgs_codec.encoder.residual.block_classes import classify_modes
from dfcgs_codec.entropy import coder, tables
from dfcgs_codec.entropy.symbols import code_bits, code_escapes, code_residuals
from dfcgs_codec.gaussians import SH_REST_COEFFICIENTS
from dfcgs_codec.model import registry
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.transform.morton import canonical_order, morton_keys
from dfcgs_codec.transform.rotation import normalise
from lab.chunks import join_chunks, split_chunks
from lab.options import encoder_options
from lab.small_clouds import all_changing, drifting, make_cloud, real_cloud, still, succeeding, waving
from tests.context_models import random_arrays as random_prior_arrays
from tests.latent_models import random_arrays

ROOT = Path(__file__).resolve().parents[1]
SPEC = (ROOT / "bitstream_spec.md").read_text(encoding="utf-8")


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_{path.stem}_of_spec", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


spec_decoder = _load(ROOT / "tests" / "spec_decoder.py")
spec_example = _load(ROOT / "tools" / "spec_example.py")


# --- constants --------------------------------------------------------------------------------------------


def _value(text: str) -> int | tuple[int, ...]:
    values = tuple(int(part, 0) for part in text.split(","))
    return values if len(values) > 1 else values[0]


def _tables() -> dict[str, dict[str, Any]]:
    """Tables of constants in the text: name of the table -> name -> value."""
    found = {}
    for match in re.finditer(r"<!-- constants: (\S+) -->\n\n((?:\|.*\n)+)", SPEC):
        rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in match[2].splitlines()]
        assert rows[0][:2] == ["name", "value"]
        found[match[1]] = {row[0]: _value(row[1]) for row in rows[2:]}
    return found


TABLES = _tables()
WEIGHTS = Path(registry.__file__).with_name("weights")
#: the models of the package, as the text's decoder reads them
MODELS = {path.stem: spec_decoder.read_npz(path.read_bytes()) for path in sorted(WEIGHTS.glob("*.npz"))}
_ENUMS = {
    kind.__name__: kind
    for kind in (
        ChunkType,
        Profile,
        OutputOrder,
        Precision,
        IntraKind,
        Tool,
        Attribute,
        tables.Shape,
    )
}
_MODULES = [name for name in TABLES if "." in name]


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return int.from_bytes(value, "big")
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return value


@pytest.mark.parametrize("table", _MODULES)
def test_constants_are_those_of_the_code(table: str) -> None:
    module = importlib.import_module(f"dfcgs_codec.{table}")
    for name, value in TABLES[table].items():
        assert _plain(getattr(module, name, getattr(module, f"_{name}", None))) == value, name


def test_every_constant_of_the_bitstream_is_in_the_text() -> None:
    code = {
        name for name, value in vars(constants).items() if name.isupper() and isinstance(value, (int, bytes))
    }
    assert code == set(TABLES["bitstream.constants"])


@pytest.mark.parametrize("table", _ENUMS)
def test_enumerations_are_those_of_the_code(table: str) -> None:
    kind: type[IntEnum] = _ENUMS[table]
    assert TABLES[table] == {member.name: member.value for member in kind}


def test_levels_and_columns_are_those_of_the_code() -> None:
    assert TABLES["LEVELS"] == {str(level): tuple(limits) for level, limits in constants.LEVELS.items()}
    assert TABLES["STATE_COLUMNS"] == {a.name: n for a, n in constants.STATE_COLUMNS.items()}


def test_reach_and_inverse_sigmas_are_those_of_the_code() -> None:
    assert TABLES["inverse_sigmas"]["INVERSE_SIGMAS"] == tuple(tables._inverse_sigmas())
    rows = re.findall(r"^\| (GAUSSIAN|LAPLACE|HEAVY) \|.*\| (\d+) \|$", SPEC, re.MULTILINE)
    assert {name: int(twice) for name, twice in rows} == {s.name: 2 * r for s, r in tables._REACH.items()}


def test_all_tables_are_known() -> None:
    others = {"LEVELS", "STATE_COLUMNS", "inverse_sigmas", "digests"}
    assert set(TABLES) == {*_MODULES, *_ENUMS, *others}


# --- citations --------------------------------------------------------------------------------------------

_HEADINGS = set(re.findall(r"^#{2,4} (\d+(?:\.\d+)*) ", SPEC, re.MULTILINE))


def _cited(text: str) -> set[str]:
    found: set[str] = set()
    for phrase in re.findall(r"spec sections? ([\d., and to]*\d)", " ".join(text.split())):
        numbers = re.findall(r"\d+(?:\.\d+)?", phrase)
        if " to " in phrase:
            numbers = [str(n) for n in range(int(numbers[0]), int(numbers[-1]) + 1)]
        found |= set(numbers)
    return found


def test_cited_sections_exist() -> None:
    sources = [*(ROOT / "src").rglob("*.py"), *(ROOT / "tools").rglob("*.py")]
    cited = {number: path.name for path in sources for number in _cited(path.read_text(encoding="utf-8"))}
    assert {number: name for number, name in cited.items() if number not in _HEADINGS} == {}
    assert {"2", "8.5", "9.4", "11.3", "13"} <= set(cited)


def test_links_of_the_contents_lead_to_headings() -> None:
    headings = re.findall(r"^#{2,4} (.*)$", SPEC, re.MULTILINE)
    anchors = {re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]*)\)", SPEC)) <= anchors


def test_references_inside_the_text_exist() -> None:
    prose = re.sub(r"```.*?```|`[^`]*`", "", SPEC, flags=re.DOTALL)
    referred = set(re.findall(r"\((\d{1,2}(?:\.\d)?)(?:, \d+(?:\.\d)?)?\)", prose))
    referred |= set(re.findall(r"[Ss]ections? (\d+(?:\.\d+)?)", prose))
    assert {number for number in referred if number not in _HEADINGS} == set()


# --- section 10 -------------------------------------------------------------------------------------------


def _digest(models: Iterator[list[int]]) -> int:
    data = b"".join(struct.pack(f"<{len(frequencies)}I", *frequencies) for frequencies in models)
    return int.from_bytes(hashlib.blake2b(data, digest_size=16).digest(), "big")


def test_scale_tables_are_those_of_the_text() -> None:
    bases = [(shape, scale) for shape in range(3) for scale in range(64)]
    for shape, scale in bases[::7]:
        code = tables.scale_table(tables.Shape(shape), scale).tolist()
        assert spec_decoder.scale_model(shape, scale).frequencies() == code
    digest = TABLES["digests"]["SCALE_TABLES_DIGEST"]
    assert _digest(spec_decoder.scale_model(*base).frequencies() for base in bases) == digest
    assert (
        _digest(tables.scale_table(tables.Shape(shape), scale).tolist() for shape, scale in bases) == digest
    )


def test_split_tables_are_those_of_the_text() -> None:
    cases = [(bias, count) for bias in range(16) for count in range(2, 33)]
    digest = TABLES["digests"]["SPLIT_TABLES_DIGEST"]
    assert _digest(spec_decoder.split_model(*case).frequencies() for case in cases) == digest
    assert _digest(tables.split_table(*case).tolist() for case in cases) == digest


def _native_and_text(rng: np.random.Generator) -> tuple[coder.Model, Any]:
    """The same model, made by the package and by the decoder of the text."""
    kind = rng.integers(4)
    if kind == 0:
        size = 1 << int(rng.integers(1, 17))
        return coder.uniform(size), spec_decoder.uniform(size)
    if kind == 1:
        bias, count = int(rng.integers(16)), int(rng.integers(2, 33))
        return coder.split_model(bias, count), spec_decoder.split_model(bias, count)
    if kind == 2:
        weights = rng.integers(0, 1 << 24, int(rng.integers(2, 200))) * rng.integers(0, 2)
        weights[0] += 1
        native = coder.categorical(tables.frequencies_from_weights(weights))
        return native, spec_decoder.from_weights(weights.tolist())
    shape, scale = int(rng.integers(3)), int(rng.integers(64))
    return coder.scale_model(tables.Shape(shape), scale), spec_decoder.scale_model(shape, scale)


def _range_encode(symbols: list[int], models: list[Any]) -> bytes:
    """Annex B."""
    lower, width, num_words = 0, 2**64 - 1, 0
    for s, model in zip(symbols, models, strict=True):
        scale = width >> 24
        lower += scale * model.cumulative[s]
        width = scale * (model.cumulative[s + 1] - model.cumulative[s])
        if width < 2**32:
            lower, width, num_words = lower << 32, width << 32, num_words + 1
    if not symbols:
        return b""
    top = (lower + 2**32 - 1) >> 32
    words = [top >> 32 * i & 0xFFFFFFFF for i in range(num_words, -1, -1)]
    if (lower + width) >> 32 == top:
        words.append(0)
    return struct.pack(f"<{len(words)}I", *words)


@pytest.mark.parametrize("seed", range(40))
def test_range_coder_is_that_of_the_text(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = [_native_and_text(rng) for _ in range(int(rng.integers(0, 60)))]
    writer = coder.RangeWriter()
    symbols, models = [], []
    for native, text in pairs:
        # rare symbols make carries and long runs of equal words likely
        drawn = rng.choice([0, text.size - 1, int(rng.integers(text.size))], int(rng.integers(1, 12)))
        writer.code(drawn.astype(np.int64), native, len(drawn))
        symbols += drawn.tolist()
        models += [text] * len(drawn)
    data = writer.getvalue()
    assert _range_encode(symbols, models) == data
    stream = spec_decoder.RangeDecoder(data)
    assert [stream.decode(model) for model in models] == symbols
    stream.finish()
    # words that are zero at the end may be missing
    stripped = data
    while stripped.endswith(bytes(4)):
        stripped = stripped[:-4]
    for reader in (spec_decoder.RangeDecoder(stripped), coder.RangeReader(stripped)):
        if isinstance(reader, coder.RangeReader):
            found = [
                int(reader.code(None, native, 1)[0])
                for native, n in _counted(pairs, models)
                for _ in range(n)
            ]
        else:
            found = [reader.decode(model) for model in models]
        assert found == symbols


def _counted(pairs: list[tuple[Any, Any]], models: list[Any]) -> Iterator[tuple[coder.Model, int]]:
    """Package's models with the number of symbols that each codes."""
    place = 0
    for native, text in pairs:
        start = place
        while place < len(models) and models[place] is text:
            place += 1
        yield native, place - start


def _outcome(decode: Callable[[], list[int]], error: type[Exception]) -> list[int] | None:
    try:
        return decode()
    except error:
        return None


@pytest.mark.parametrize("seed", range(30))
def test_any_words_decode_alike_and_end_alike(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    words = rng.integers(0, 1 << 32, int(rng.integers(0, 6)), np.uint64)
    words[rng.random(len(words)) < 0.4] = (1 << 32) - 1
    data = words.astype("<u4").tobytes()
    pairs = [_native_and_text(rng) for _ in range(int(rng.integers(0, 14)))]

    def native() -> list[int]:
        reader = coder.RangeReader(data)
        found = [int(reader.code(None, model, 1)[0]) for model, _ in pairs]
        reader.finish()
        return found

    def text() -> list[int]:
        stream = spec_decoder.RangeDecoder(data)
        found = [stream.decode(model) for _, model in pairs]
        stream.finish()
        return found

    assert _outcome(native, CorruptBitstream) == _outcome(text, spec_decoder.Refused)


@pytest.mark.parametrize(
    ("words", "num_symbols", "whole"),
    [
        ([], 0, True),
        ([9, 2], 0, True),
        ([0, 0, 0], 0, False),
        ([], 5, True),
        ([1, 0xFFFFFFFE], 1, True),
        ([1, 0xFFFFFFFF], 1, False),
        ([2, 0], 1, False),
        ([0, 0, 0], 1, False),
    ],
)
def test_the_end_of_a_stream(words: list[int], num_symbols: int, whole: bool) -> None:
    data = struct.pack(f"<{len(words)}I", *words)
    reader, stream = coder.RangeReader(data), spec_decoder.RangeDecoder(data)
    assert reader.code(None, coder.uniform(2), num_symbols).tolist() == [0] * num_symbols
    assert [stream.decode(spec_decoder.uniform(2)) for _ in range(num_symbols)] == [0] * num_symbols
    for finish, error in ((reader.finish, CorruptBitstream), (stream.finish, spec_decoder.Refused)):
        if whole:
            finish()
        else:
            with pytest.raises(error):
                finish()


def test_a_quantile_beyond_the_models_is_refused() -> None:
    with pytest.raises(CorruptBitstream):
        coder.RangeReader(b"\xff" * 8).code(None, coder.uniform(2), 1)
    with pytest.raises(spec_decoder.Refused):
        spec_decoder.RangeDecoder(b"\xff" * 8).decode(spec_decoder.uniform(2))


@pytest.mark.parametrize("seed", range(12))
def test_residuals_escapes_and_bits_are_those_of_the_text(seed: int) -> None:
    rng = np.random.default_rng(2000 + seed)
    count = int(rng.integers(0, 80))
    wide = rng.integers(-(1 << 40), 1 << 40, count) >> rng.integers(8, 41, count)
    contexts = rng.integers(0, 5, count)
    chosen = rng.integers(0, 480, 5)
    chosen[:2] = rng.choice([0, 63, 64, 159], 2)
    escapes = rng.integers(0, (1 << 32) - 1, count) >> rng.integers(0, 33, count)
    width = int(rng.integers(0, 64))
    raw = rng.integers(0, 1 << 62, count) & ((1 << width) - 1)
    writer = coder.RangeWriter()
    code_residuals(writer, wide, contexts, chosen)
    code_escapes(writer, escapes, count)
    code_bits(writer, raw, width, count)
    stream = spec_decoder.RangeDecoder(writer.getvalue())
    assert stream.residuals(contexts.tolist(), dict(enumerate(chosen.tolist()))) == wide.tolist()
    assert stream.escapes(count) == escapes.tolist()
    assert stream.bits(width, count) == raw.tolist()
    stream.finish()


# --- annex A ----------------------------------------------------------------------------------------------


def _example_block(name: str) -> list[str]:
    match = re.search(rf"<!-- example: {name} -->\n\n```\n(.*?)\n```", SPEC, re.DOTALL)
    assert match is not None
    return match[1].splitlines()


def _bytes_of(lines: list[str]) -> bytes:
    data = b""
    for line in lines:
        assert int(line[:4], 16) == len(data)
        data += bytes.fromhex(line[6:54])
    return data


def test_example_is_what_the_tool_makes() -> None:
    for name, lines in spec_example.blocks().items():
        assert _example_block(name) == lines, f"run tools/spec_example.py --update ({name})"
    assert _bytes_of(_example_block("file")) == spec_example.build()


def test_example_decodes_as_written() -> None:
    data = _bytes_of(_example_block("file"))
    written = dict(
        re.findall(r"^frame (\d), number \d: hash ([0-9a-f]{32})$", "\n".join(_example_block("frames")), re.M)
    )
    decoded = list(SequenceDecoder(io.BytesIO(data)).frames())
    assert {str(f.index): f.state.hash().hex() for f in decoded} == written
    assert {
        str(f.index): f.state.hash().hex() for f in spec_decoder.Decoder(data, MODELS).frames()
    } == written
    assert len(written) == 2


# --- the decoder of the text against the package ----------------------------------------------------------


def _cloud(rng: np.random.Generator, count: int, sh_degree: int) -> GaussianCloud:
    shape = (count, 3, SH_REST_COEFFICIENTS[sh_degree])
    return GaussianCloud(
        positions=rng.normal(size=(count, 3)).astype(np.float32),
        rotations=rng.normal(size=(count, 4)).astype(np.float32),
        scales=rng.normal(-4, 1, (count, 3)).astype(np.float32),
        opacities=rng.normal(0, 4, count).astype(np.float32),
        sh_dc=rng.normal(size=(count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, shape).astype(np.float32),
    )


def _moved(rng: np.random.Generator, cloud: GaussianCloud, share: float) -> GaussianCloud:
    rows = (rng.random(cloud.num_gaussians) < share)[:, None]
    turn = rng.normal(0, 0.05, (cloud.num_gaussians, 4)) * rows
    fade = rng.normal(0, 0.3, cloud.num_gaussians) * rows[:, 0]
    return replace(
        cloud,
        positions=cloud.positions + (rng.normal(0, 0.02, (cloud.num_gaussians, 3)) * rows).astype(np.float32),
        rotations=cloud.rotations + turn.astype(np.float32),
        opacities=cloud.opacities + fade.astype(np.float32) * (share < 1),
    )


def _sequence(rng: np.random.Generator, count: int, sh_degree: int) -> list[GaussianCloud]:
    frames = [_cloud(rng, count, sh_degree)]
    for share in (0.3, 0.3, 0.0, 1.0, 1.0):
        frames.append(_moved(rng, frames[-1], share))
    return frames


def _flat(sh_rest: np.ndarray) -> np.ndarray:
    return sh_rest.reshape(len(sh_rest), 3 * sh_rest.shape[2])


def _check_output(frame: Any, cloud: GaussianCloud) -> None:
    found = frame.output()
    expected = {
        **{name: cloud.positions[:, i] for i, name in enumerate("xyz")},
        **{f"scale_{i}": cloud.scales[:, i] for i in range(3)},
        **{f"rot_{i}": cloud.rotations[:, i] for i in range(4)},
        "opacity": cloud.opacities,
        **{f"f_dc_{i}": cloud.sh_dc[:, i] for i in range(3)},
        **{f"f_rest_{i}": v for i, v in enumerate(_flat(cloud.sh_rest).T)},
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(np.array(found[name], values.dtype), values, equal_nan=True), name


def _check_file(data: bytes, models: Any = None) -> list[bytes]:
    """Hashes of all frames, the same in the file, in the package and in the decoder of the text."""
    package = list(SequenceDecoder(io.BytesIO(data)).frames())
    text = list(spec_decoder.Decoder(data, models or MODELS).frames())
    for ours, theirs in zip(text, package, strict=True):
        assert ours.state.hash() == theirs.state.hash(), f"frame {ours.index}"
        assert ours.frame_hash == ours.state.hash()
        assert ours.sequence.frame_numbers[ours.index] == theirs.number
        _check_output(ours, theirs.cloud())
    return [frame.frame_hash for frame in text]


@pytest.mark.parametrize(
    ("count", "sh_degree", "order", "intra"),
    [
        (1, 0, OutputOrder.SEQUENCE, IntraKind.CODED),
        (40, 0, OutputOrder.INPUT, IntraKind.CODED),
        (77, 1, OutputOrder.FREE, IntraKind.CODED),
        (130, 1, OutputOrder.SEQUENCE, IntraKind.CODED),
        (200, 0, OutputOrder.INPUT, IntraKind.CODED),
        (66, 2, OutputOrder.INPUT, IntraKind.CODED),
        (70, 0, OutputOrder.INPUT, IntraKind.PLY),
        (50, 3, OutputOrder.SEQUENCE, IntraKind.PLY),
    ],
)
def test_encoded_sequences(
    tmp_path: Path, count: int, sh_degree: int, order: OutputOrder, intra: IntraKind
) -> None:
    rng = np.random.default_rng(count)
    target = tmp_path / "sequence.dgs"
    options = encoder_options(order=order, intra=intra, gof_size=4)
    encode_sequence(_sequence(rng, count, sh_degree), target, options)
    assert len(_check_file(target.read_bytes())) == 6


def test_all_levels_of_detail(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    cloud = _cloud(rng, 8300, 0)
    # smooth over space, so that neighbours are worth using
    smooth = np.sin(3 * cloud.positions @ rng.normal(size=(3, 3))).astype(np.float32)
    cloud = replace(cloud, sh_dc=smooth, scales=smooth - 4)
    target = tmp_path / "sequence.dgs"
    encode_sequence([cloud], target, EncoderOptions(order=OutputOrder.INPUT))
    _check_file(target.read_bytes())


CONFORMANCE = ROOT / "tests" / "conformance"


@pytest.mark.parametrize("path", sorted((CONFORMANCE / "valid").glob("*.dgs")), ids=lambda path: path.stem)
def test_conformance_streams(path: Path) -> None:
    expected = json.loads((CONFORMANCE / "expected.json").read_text(encoding="utf-8"))
    hashes = [frame.hex() for frame in _check_file(path.read_bytes())]
    assert hashes == expected["valid"][path.stem]["frame_hashes"]


FAULTY_BY_TEXT = (
    "rotation_symbol_too_large",
    "step_too_large",
    "alternating_positions",
    "too_many_control_points",
)


@pytest.mark.parametrize("name", FAULTY_BY_TEXT)
def test_faulty_streams_are_refused_by_the_text_alone(name: str) -> None:
    """Before any hash is looked at."""
    data = (CONFORMANCE / "faulty" / f"{name}.dgs").read_bytes()
    with pytest.raises(spec_decoder.Refused):
        list(spec_decoder.Decoder(data, MODELS).frames())


# --- streams with choices that no sensible encoder makes --------------------------------------------------


class RandomWriter(SymbolWriter):
    """Settles at random how symbols are coded."""

    rng = np.random.default_rng(0)

    def weights(self, count: int, evidence: Any) -> Any:
        weights = self.rng.integers(-90, 90, count) * (self.rng.random(count) < 0.6)
        weights[0] = self.rng.choice([0, 0, 100, 256, 400])
        return code_weights(self, weights, count)

    def tables(self, num_contexts: int, evidence: Any) -> Any:
        chosen = np.full(num_contexts, -1, np.int64)
        first = int(self.rng.integers(num_contexts))
        for context in range(first, int(self.rng.integers(first, num_contexts)) + 1):
            chosen[context] = self.rng.integers(480) if self.rng.random() < 0.7 else 160 + 40
        return code_tables(self, chosen, num_contexts)

    def histograms(self, used: Any, num_contexts: int, size: int, evidence: Any) -> Any:
        levels = self.rng.integers(0, 64, (len(used), size))
        levels[:, self.rng.integers(size)] = self.rng.integers(0, 63)
        return histogram_models(self, levels, used, num_contexts, size)

    def choice(self, size: int, evidence: Callable[[], int]) -> int:
        return super().choice(size, lambda: int(self.rng.integers(size)))

    def predictor(self, num_before: int, evidence: Any) -> Any:
        center = code_signed(self, int(self.rng.integers(-50, 50)), constants.STATE_LIMIT)
        return center, self.weights(1 + num_before, None), self.weights(2 + num_before, None)


def _random_indices(rng: np.random.Generator, count: int, grid: SortGrid) -> Any:
    """Coarse indices in canonical order."""
    indices = rng.integers(-20, 40, (count, 3))
    indices[rng.random(count) < 0.3] = indices[0]
    if grid.has_excess:
        indices[rng.random(count) < 0.1] *= int(rng.integers(1, 5000))
    wide = (indices >> grid.shift) - np.array(grid.origin)
    top = (1 << grid.bits) - 1
    if not grid.has_excess:
        wide = np.clip(wide, 0, top)
        indices = ((wide + np.array(grid.origin)) << grid.shift) | (indices & ((1 << grid.shift) - 1))
    return indices[canonical_order(morton_keys(np.clip(wide, 0, top)), indices)]


@dataclass
class _FlaggedActivity(AttributeActivity):
    """With flags on Gaussians that have no symbols, too."""

    flagged: Any = False

    def significant(self) -> Any:
        return super().significant() | self.flagged


def _inter_symbols(rng: np.random.Generator, planes: list[Attribute], count: int) -> InterSymbols:
    activity: dict[Attribute, AttributeActivity] = {}
    block = np.arange(count) >> BLOCK_LOG2
    for attribute in planes:
        if rng.random() < 0.3:
            continue
        columns = 3 if attribute == Attribute.ROTATION else constants.STATE_COLUMNS[attribute]
        share = rng.choice([0.0, 0.05, 0.5, 1.0])
        symbols = rng.integers(-30, 30, (count, columns)) * (rng.random((count, columns)) < share)
        significant = np.zeros(block[-1] + 1, bool)
        np.logical_or.at(significant, block, symbols.any(axis=1))
        density = np.where(
            significant, rng.integers(1, 4, len(significant)), rng.integers(0, 4, len(significant))
        )
        if rng.random() < 0.3:
            density[:] = 3
        # beyond the 24 classes, too: decoders clip
        magnitude = np.where(density > 0, rng.integers(-3, 30, len(density)), 0)
        flagged = rng.random(count) < rng.choice([0.0, 0.3])
        flagged &= density[block] > 0
        activity[attribute] = _FlaggedActivity(
            symbols.astype(np.int64), density, magnitude, None, None, flagged
        )
    return InterSymbols(activity)


def _random_grid(rng: np.random.Generator) -> SortGrid:
    origin = tuple(rng.integers(-30, 30, 3).tolist())
    return SortGrid(int(rng.integers(0, 3)), int(rng.integers(0, 7)), origin, bool(rng.integers(2)))


def _random_control(rng: np.random.Generator) -> ControlHeader:
    return ControlHeader(int(rng.choice([1, 2, 7, 1000])), int(rng.integers(0, 9)))


def _random_motion(rng: np.random.Generator, before: GofState) -> MotionGoal | None:
    if rng.random() < 0.3:
        return None
    motion = before.motion()
    points, count = motion.field.num_points, before.frame.num_gaussians
    header = MotionHeader(
        int(rng.integers(1, 300)),
        int(rng.choice([0, 1, 900])),
    )
    control = rng.integers(-9, 10, (points, 6)) * (rng.random((points, 6)) < rng.random())
    control[:, header.num_columns :] = 0
    follows = rng.random(count) < rng.choice([0.0, 0.5, 1.0])
    symbols = MotionSymbols(control, classify_modes(follows), follows)
    return MotionGoal(header, symbols, motion.carry(header, symbols, before.frame))


def _random_topology(
    rng: np.random.Generator, before: GofState, attributes: list[Attribute]
) -> TopologyGoal | None:
    if rng.random() < 0.4:
        return None
    count = before.frame.num_gaussians
    kept = np.flatnonzero(rng.random(count) < rng.choice([0.3, 0.9, 1.0]))
    if len(kept) == 0:
        kept = rng.integers(0, count, 1)
    num_births = int(rng.choice([0, 1, 30, 150]))
    births = None
    if num_births:
        births = _random_task(rng, num_births, attributes, before.visibility.units)
        births = replace(births, target=replace(births.target, permutation=None))
    total = len(kept) + num_births
    inputs = rng.permutation(total) if rng.random() < 0.4 else None
    return frame_coding.topology_goal(kept, count, births, inputs)


def _random_task(
    rng: np.random.Generator, count: int, attributes: list[Attribute], units: UnitExponents
) -> frame_coding.IntraTask:
    """An I-frame, or births."""
    grid, log2 = _random_grid(rng), int(rng.choice([0, 0, 1, 3, 8]))
    coarse = _random_indices(rng, count, grid)
    steps = {attribute: int(rng.integers(1, 400)) for attribute in attributes}
    # beyond the cube of the stereographic vector, too
    steps[Attribute.ROTATION] = int(rng.integers(1, 6000))
    # so that far outliers stay on the grid
    steps[Attribute.POSITION] = max(1, steps[Attribute.POSITION] >> log2)
    levels = {attribute: int(rng.integers(-300, 500)) for attribute in attributes}
    alternating = frozenset(a for a in attributes if a != Attribute.POSITION and rng.random() < 0.7)
    rule = IntraSteps(steps, log2, levels, int(rng.choice([0, 1, 6, 8])), alternating)
    planes = {
        a: np.cumsum(rng.integers(-900, 900, (count, constants.STATE_COLUMNS[a])), axis=0) for a in attributes
    }
    planes[Attribute.ROTATION] = normalise(rng.integers(-(1 << 23), 1 << 23, (count, 4)))
    bounded = frozenset(a for a in attributes if a == Attribute.OPACITY or rng.random() < 0.3)
    target = IntraTarget(
        planes,
        coarse << log2 | rng.integers(0, 1 << log2, coarse.shape),
        np.clip(rng.integers(-4, 5, count).cumsum() // 4, 0, 15) * int(rng.integers(0, 2)),
        rule,
        Quantisation(units, {}, bounded, {}, frozenset()),
        0.6,
        rng.permutation(count) if rng.random() < 0.5 else None,
        bool(rng.integers(0, 2)),
    )
    return frame_coding.IntraTask(target, grid)


def _random_intra(
    rng: np.random.Generator, index: int, attributes: list[Attribute], header: SequenceHeader
) -> frame_coding.CodedFrame:
    # passes with two quantisers, now and then
    count = int(rng.integers(1, rng.choice([20, 200, 200, 1200])))
    model = registry.context_model(header.model_id)
    control, writer = _random_control(rng), FrameWriter(header, model, index)
    if rng.random() < 0.3:
        permutation = rng.permutation(count) if rng.random() < 0.5 else None
        cloud = _cloud(rng, count, header.sh_degree)
        return frame_coding.coded_verbatim(writer, cloud, permutation, control)
    task = _random_task(rng, count, attributes, header.unit_exponents)
    return frame_coding.coded_intra(writer, task, control)


def _random_inter(
    rng: np.random.Generator,
    writer: FrameWriter,
    attributes: list[Attribute],
    before: frame_coding.CodedFrame,
) -> frame_coding.CodedFrame:
    present = attributes if rng.random() < 0.8 else []
    change = _random_topology(rng, before.state, attributes)
    state = before.state
    if change is not None:
        state = state.survivors(change.kept)
    symbols = _inter_symbols(rng, present, state.frame.num_gaussians)
    steps = {attribute: int(rng.integers(1, 3000)) for attribute in attributes}
    trial = _random_motion(rng, state)
    levels = {}
    if rng.random() < 0.6:
        levels = {attribute: int(rng.integers(-500, 500)) for attribute in attributes}
    coded = frame_coding.coded_inter(writer, symbols, before.state, (steps, levels), trial, change)
    for activity in coded.state.history.activity.values():
        np.clip(activity.magnitude, 0, 23, out=activity.magnitude)
    return coded


def _random_file(rng: np.random.Generator, model: ContextModel) -> bytes:
    sh_degree, num_frames = int(rng.integers(2)), 6
    attributes = list(Attribute)[: Attribute.SH_1 + sh_degree]
    numbers = FrameNumbers.of(sorted(rng.choice(12, num_frames, replace=False).tolist()))
    units = UnitExponents(*rng.integers(-16, -10, 4).tolist())
    header = SequenceHeader(Profile.MAIN, 1, sh_degree, OutputOrder.FREE, (25, 1), numbers, units)
    header = replace(header, model_id=model.model_id, model_hash=model.digest[:8])
    file = io.BytesIO()
    writer = ContainerWriter(file, header)
    coded = None
    gofs: list[list[bytes]] = []
    for index in range(num_frames):
        if coded is None or rng.random() < 0.2:
            coded = _random_intra(rng, index, attributes, header)
            gofs.append([])
        else:
            coded = _random_inter(rng, FrameWriter(header, model, index), attributes, coded)
        gofs[-1].append(coded.data)
    first = 0
    for chunks in gofs:
        writer.gof(first, chunks)
        first += len(chunks)
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize("seed", range(30))
def test_random_choices(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    model, models = _random_prior(seed, monkeypatch)
    monkeypatch.setattr(chunk_writer, "SymbolWriter", RandomWriter)
    monkeypatch.setattr(RandomWriter, "rng", rng)
    _check_file(_random_file(rng, model), models)


# --- section 16 -------------------------------------------------------------------------------------------


def _as_text_reads(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    return {
        name: spec_decoder.Array(
            array.dtype.str.replace("=", "<"), tuple(array.shape), array.ravel().tolist()
        )
        for name, array in arrays.items()
    }


@pytest.mark.parametrize(
    ("seed", "sh_degree", "without", "changes"),
    [
        (1, 0, (), {}),
        (2, 2, (), {"refinement": RefinementMode.ON, "latent_step": 0.5, "control_spacing": 9}),
        (3, 3, ("hyper_synthesis", "grid_context"), {"latent_step": 8, "num_neighbours": 5, "qp": 40}),
        (4, 1, ("appearance",), {"refinement": RefinementMode.ON, "intra": IntraKind.PLY, "gof_size": 2}),
        (5, 1, ("refinement",), {"latent_step": 1 / 16, "qp": 8}),
    ],
)
def test_networks(
    seed: int,
    sh_degree: int,
    without: tuple[str, ...],
    changes: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Networks of random integers, in every frame, whether they lead nearer or not."""
    arrays = random_arrays(seed, without=without, gain=40 * seed)
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(LatentModel.of_arrays("random", arrays))
    monkeypatch.setattr(LatentCoder, "_leads_nearer", lambda *_: True)
    frames = _sequence(np.random.default_rng(seed), 150, sh_degree)[:4]
    target = tmp_path / "random.dgs"
    options = encoder_options(profile=Profile.PAPER, model_id="random", **({"control_spacing": 15} | changes))
    report = encode_sequence(frames, target, options)
    assert sum(frame.kind == "P" for frame in report.frames) >= 1
    _check_file(target.read_bytes(), {"random": _as_text_reads(arrays)})


def test_the_text_names_every_model() -> None:
    rows = []
    for start, end in (("### 16.1 ", "### 16.2 "), ("### 17.1 ", "### 17.2 ")):
        text = SPEC[SPEC.index(start) : SPEC.index(end)]
        rows += re.findall(r"^\| `([\w.-]+)` \| ([0-9a-f]{16}) \|$", text, re.M)
    found = {name: spec_decoder.model_hash(arrays).hex()[:16] for name, arrays in MODELS.items()}
    assert dict(rows) == found
    assert {name: registry.installed(name).digest.hex()[:16] for name in found} == found


# --- section 17 -------------------------------------------------------------------------------------------


def _random_prior(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[ContextModel, dict[str, Any]]:
    """A prior of random integers, registered, and as the text's decoder reads it."""
    arrays = random_prior_arrays(seed)
    model = ContextModel.of_arrays("random", arrays)
    monkeypatch.setattr(registry, "_registered", {})
    registry.register(model)
    return model, {"random": _as_text_reads(arrays)}


def _small(count: int, sh_degree: int = 0) -> GaussianCloud:
    """Gaussians so small that motion is worth its bytes."""
    cloud = make_cloud(count, sh_degree, 3)
    return replace(cloud, scales=cloud.scales - 3)


def _waving(frames: list[GaussianCloud]) -> list[GaussianCloud]:
    return [waving(cloud, 0.1 * index) for index, cloud in enumerate(frames)]


_MOVING: dict[str, Any] = {"control_spacing": 15}
#: frames, and options of the encoder
PRIOR_SEQUENCES: dict[str, tuple[Callable[[], list[GaussianCloud]], dict[str, Any]]] = {
    "tracked": (lambda: drifting(real_cloud(300), 4), {}),
    "one": (lambda: drifting(make_cloud(1), 3), {}),
    "few": (lambda: all_changing(make_cloud(40, 1), 4), {}),
    "all attributes": (lambda: all_changing(make_cloud(200, 3), 3), {}),
    "uniform steps": (
        lambda: all_changing(make_cloud(150, 1), 4),
        {"visibility": False, "qp": 24},
    ),
    "several GoFs": (lambda: all_changing(make_cloud(100), 7), {"gof_size": 3}),
    "verbatim": (lambda: all_changing(make_cloud(100), 3), {"intra": IntraKind.PLY}),
    "motion": (lambda: _waving(still(_small(300), 5)), _MOVING),
    "motion and change": (lambda: _waving(all_changing(_small(400, 1), 4)), _MOVING),
    "births and deaths": (lambda: succeeding(_small(600), 4), {"control_spacing": 20}),
    "lost order": (
        lambda: succeeding(_small(300, 1), 4, shuffle=True),
        {**_MOVING, "order": OutputOrder.INPUT},
    ),
    "levels left out, few coded": (
        lambda: drifting(real_cloud(2300), 3, 0.05),
        {"motion": MotionMode.OFF},
    ),
    "levels left out, all coded": (lambda: all_changing(make_cloud(2112), 3), {"qp": 24}),
}


@pytest.mark.parametrize("name", PRIOR_SEQUENCES)
def test_priors(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Networks and tables of random integers."""
    make, changes = PRIOR_SEQUENCES[name]
    _, models = _random_prior(sorted(PRIOR_SEQUENCES).index(name), monkeypatch)
    target = tmp_path / "random.dgs"
    report = encode_sequence(make(), target, encoder_options(model_id="random", **changes))
    assert sum(frame.kind == "P" for frame in report.frames) >= 2
    _check_file(target.read_bytes(), models)


def test_logarithms_are_those_of_the_text() -> None:
    values = np.concatenate([np.arange(4096), (1 << np.arange(3, 62)) - 1, 1 << np.arange(62)])
    assert [spec_decoder.log(a) for a in values.tolist()] == log_of(values).tolist()


def _with_model(data: bytes, **changes: Any) -> bytes:
    """A file whose header names another model, or has another profile."""
    chunks = split_chunks(data)
    writer = ByteWriter()
    replace(SequenceHeader.read(ByteReader(chunks[0].payload)), **changes).write(writer)
    return join_chunks([replace(chunks[0], payload=writer.getvalue()), *chunks[1:]])


@pytest.mark.parametrize("profile", [Profile.MAIN, Profile.PAPER])
def test_models_that_do_not_fit(profile: Profile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prior, models = _random_prior(0, monkeypatch)
    arrays = random_arrays(0)
    network = LatentModel.of_arrays("network", arrays)
    registry.register(network)
    models |= {"network": _as_text_reads(arrays)}
    own, other = (prior, network) if profile == Profile.MAIN else (network, prior)
    target = tmp_path / "sequence.dgs"
    options = encoder_options(profile=profile, model_id=own.model_id)
    encode_sequence(drifting(make_cloud(20), 2), target, options)
    data = target.read_bytes()
    assert len(_check_file(data, models)) == 2
    named = {"model_id": other.model_id, "model_hash": other.digest[:8]}
    refused: list[tuple[dict[str, Any], dict[str, Any]]] = [
        (named, models),
        ({"profile": Profile.PAPER if profile == Profile.MAIN else Profile.MAIN}, models),
        ({"model_id": "unknown"}, models),
        ({"model_hash": bytes(8)}, models),
        ({"model_hash": other.digest[:8]}, models),
        ({"model_id": ""}, models),
    ]
    for changes, known in refused:
        damaged = _with_model(data, **changes)
        with pytest.raises(BitstreamError) as caught:
            list(SequenceDecoder(io.BytesIO(damaged)).frames())
        assert caught.value.code == "model-mismatch"
        with pytest.raises(spec_decoder.ModelMismatch):
            list(spec_decoder.Decoder(damaged, known).frames())


# --- section 19 -------------------------------------------------------------------------------------------


def _patched(field: str, value: bytes, chunk: int = 0) -> bytes:
    """The worked example with the bytes of a field replaced and the checksum of its chunk made right.

    `chunk` counts the chunks that have such a field.
    """
    lines = _example_block("file")
    data = bytearray(_bytes_of(lines))
    starts = [int(line[:4], 16) for line in lines if line[55:].startswith("chunk_type")]
    ends = [int(line[:4], 16) for line in lines if line[55:].startswith("crc32")]
    places = [int(line[:4], 16) for line in lines if line[55:].split(" = ")[0] == field]
    place = places[chunk]
    data[place : place + len(value)] = value
    for start, end in zip(starts, ends, strict=True):
        if start <= place < end:
            data[end : end + 4] = struct.pack("<I", zlib.crc32(data[start:end]))
    return bytes(data)


_PLAIN = _bytes_of(_example_block("file"))
_CHUNKS = [int(line[:4], 16) for line in _example_block("file") if line[55:].startswith("chunk_type")]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"PK" + _PLAIN, "not-a-dgs-file"),
        (b"glps" + _PLAIN, "not-a-dgs-file"),
        (_PLAIN[:5], "truncated"),
        (_PLAIN[: _CHUNKS[2] + 20], "truncated"),
        (_PLAIN[: _CHUNKS[-1]], "truncated"),
        (_PLAIN + b"\0", "corrupt"),
        (_PLAIN[: _CHUNKS[3]] + _PLAIN[_CHUNKS[-2] :], "corrupt"),
        (_PLAIN[: _CHUNKS[2]] + _PLAIN[_CHUNKS[3] :], "corrupt"),
        (_PLAIN[: _CHUNKS[4]] + _PLAIN[_CHUNKS[5] :], "corrupt"),
        (_PLAIN[: _CHUNKS[1]] + _PLAIN[8:], "corrupt"),
        (_PLAIN[:100] + b"!" + _PLAIN[101:], "corrupt"),
        (_patched("bitstream_version", bytes([constants.BITSTREAM_VERSION - 1])), "unsupported"),
        (_patched("bitstream_version", bytes([constants.BITSTREAM_VERSION + 1])), "unsupported"),
        (_patched("profile", b"\1"), "model-mismatch"),
        (_patched("profile", b"\2"), "unsupported"),
        (_patched("level", b"\0"), "unsupported"),
        (_patched("sh_degree", b"\4"), "limit"),
        (_patched("output_order", b"\3"), "unsupported"),
        (_patched("num_frames", b"\0"), "corrupt"),
        (_patched("num_frames", b"\3"), "corrupt"),
        (_patched("num_frames", b"\1"), "corrupt"),
        (_patched("frame_rate_denominator", b"\0"), "corrupt"),
        (_patched("run_length_minus_1", b"\0"), "corrupt"),
        (_patched("scale_exponent", bytes([61 * 2])), "limit"),
        (_patched("opacity_exponent", bytes([10 * 2 - 1])), "limit"),
        (_patched("model_id_length", b"\x7f"), "limit"),
        (_patched("model_id_length", b"\1"), "corrupt"),
        (_patched("chunk_type", b"\x22", 1), "corrupt"),
        (_patched("chunk_type", b"\x21", 1), "corrupt"),
        (_patched("chunk_type", b"\x23", 1), "corrupt"),
        (_patched("chunk_type", b"\x42", 1), "unsupported"),
        (_patched("frame_index", b"\1", 2), "corrupt"),
        (_patched("frame_hash", b"\0" * 16), "verification"),
        (_patched("frame_hash", b"\0" * 16, 1), "verification"),
        (_patched("intra_kind", b"\2"), "unsupported"),
        (_patched("num_gaussians", b"\0"), "corrupt"),
        (_patched("num_gaussians", b"\xff\xff\x7f"), "limit"),
        (_patched("has_permutation", b"\2"), "limit"),
        (_patched("has_permutation", b"\0"), "corrupt"),
        (_patched("control_spacing", b"\0"), "corrupt"),
        (_patched("control_shift", bytes([32])), "limit"),
        (_patched("sort_shift", bytes([32])), "limit"),
        (_patched("sort_bits", bytes([22])), "limit"),
        (_patched("has_excess", b"\2"), "limit"),
        (_patched("step of POSITION", b"\0"), "corrupt"),
        (_patched("step of SCALE", b"\x84\0"), "corrupt"),
        (_patched("stream_length of POSITION", b"\x05"), "corrupt"),
        (_patched("stream of POSITION", b"\xff" * 4), "corrupt"),
        (_patched("tools", b"\x81"), "unsupported"),
        (_patched("tools", b"\0"), "corrupt"),
        (_patched("tools", b"\1"), "corrupt"),
        (_patched("tools", b"\x0d"), "corrupt"),
        (_patched("tools", b"\x15"), "corrupt"),
        (_patched("visibility_level of POSITION", b"\x80\0"), "corrupt"),
        (_patched("translation_step", b"\0"), "corrupt"),
        (_patched("attribute_mask", b"\x25"), "corrupt"),
    ],
)
def test_refusals(data: bytes, code: str) -> None:
    with pytest.raises((BitstreamError, VerificationError)) as caught:
        list(SequenceDecoder(io.BytesIO(data)).frames())
    assert caught.value.code == code


def test_unknown_ancillary_chunks_are_skipped() -> None:
    data = _patched("chunk_type", b"\x90", 1)
    assert len(list(SequenceDecoder(io.BytesIO(data)).frames())) == 2
    damaged = bytearray(data)
    damaged[_CHUNKS[1] + 5] ^= 1
    with pytest.raises(CorruptBitstream):
        list(SequenceDecoder(io.BytesIO(bytes(damaged))).frames())


def test_text_names_every_error() -> None:
    codes = {kind.code: kind.__name__ for kind in BitstreamError.__subclasses__()}
    codes |= {VerificationError.code: VerificationError.__name__}
    text = SPEC[SPEC.index("## 19 ") : SPEC.index("## 20 ")]
    written = {code: name for name, code in re.findall(r"^\| `(\w+)` \| `([\w-]+)` \|", text, re.M)}
    assert written == codes


def test_index_leads_to_every_gof(tmp_path: Path) -> None:
    target = tmp_path / "sequence.dgs"
    encode_sequence(_sequence(np.random.default_rng(3), 60, 0), target, EncoderOptions(gof_size=2))
    data = target.read_bytes()
    all_frames = [frame.frame_hash for frame in spec_decoder.Decoder(data, MODELS).frames()]
    for start in range(6):
        assert [f.state.hash() for f in decode_sequence(target, start, start + 1)] == [all_frames[start]]
