from __future__ import annotations

import numpy as np
import pytest

from dfcgs_codec.codec.columns.reader import SymbolReader
from dfcgs_codec.codec.intra.turns import TurnWalk
from dfcgs_codec.encoder.columns.writer import SymbolWriter
from dfcgs_codec.encoder.intra.turn_choice import TurnChooser, settled_names
from dfcgs_codec.encoder.matching.canonical import AxisNames
from dfcgs_codec.transform.lod import build_levels
from dfcgs_codec.transform.rotation import ONE, from_float, multiply, normalise


def rotation(count: int, tilt: int = 400, spin: int = 400, *, alternating: bool = False) -> TurnWalk:
    rng = np.random.default_rng(5)
    positions = np.sort(rng.integers(0, 3000, (count, 3)), axis=0)
    needles = rng.random(count) < 0.5
    steps = np.full(count, tilt), np.full(count, spin)
    return TurnWalk(*steps, needles, build_levels(positions), alternating)


def any_turns(count: int) -> np.ndarray:
    return normalise(np.random.default_rng(count).integers(-(1 << 23), 1 << 23, (count, 4)))


def alike(count: int) -> np.ndarray:
    noise = np.random.default_rng(2).normal(0, 0.02, (count, 4)).astype(np.float32)
    return from_float(noise + np.array([0.5, 0.7, -0.1, 0.3], np.float32))


def relative(decoded: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return multiply(decoded * np.array([1, -1, -1, -1]), wanted) / ONE


def code(walk: TurnWalk, wanted: np.ndarray, *, keeps_names: bool = False) -> tuple[np.ndarray, int]:
    writer = SymbolWriter()
    written = walk.code(writer, TurnChooser(wanted, walk).choose, keeps_names=keeps_names)
    reader = SymbolReader(writer.getvalue(), 0)
    assert np.array_equal(walk.code(reader, None), written)
    reader.finish()
    return written, len(writer.getvalue())


@pytest.mark.parametrize("count", [1, 2, 63, 64, 3000])
@pytest.mark.parametrize("make", [any_turns, alike])
def test_turns_come_back_within_their_steps(count: int, make: object) -> None:
    wanted = make(count)  # type: ignore[operator]
    found, _ = code(rotation(count), wanted)
    # three components off by half a step of 400 / 2**18, each worth four radians a unit
    limit = np.degrees(np.sqrt(3) * 2 * 400 / 2**18)
    turn = np.abs(relative(found, wanted)).max(axis=1)
    assert np.degrees(2 * np.arccos(np.clip(turn, 0, 1))).max() < 1.1 * limit


def test_names_are_kept_where_asked() -> None:
    wanted = any_turns(500)
    freely, fewer = code(rotation(500), wanted)
    assert len(np.unique(np.abs(relative(freely, wanted)).argmax(axis=1))) == 4
    kept, more = code(rotation(500), wanted, keeps_names=True)
    assert (np.abs(relative(kept, wanted))[:, 0] > 0.999).all()
    # two bits each, for names were anyhow
    assert more - fewer < 500 * 2 / 8 + 24


def test_names_that_are_natural_cost_nothing() -> None:
    walk, wanted = rotation(800), any_turns(800)
    natural, size = code(walk, wanted)
    again, same = code(walk, natural, keeps_names=True)
    assert (np.abs(relative(again, natural))[:, 0] > 0.999).all()
    assert same <= size + 8


def test_settled_names_lead_to_what_was_decoded() -> None:
    wanted = any_turns(300)
    decoded, _ = code(rotation(300), wanted)
    ones = np.zeros((300, 4), np.int64)
    ones[:, 0] = ONE
    names = settled_names(AxisNames(np.tile(np.arange(3), (300, 1)), ones), wanted, decoded)
    renamed = multiply(wanted, names.turns)
    assert (np.abs(relative(decoded, renamed))[:, 0] > 0.999).all()


def test_neighbours_that_agree_save_bytes() -> None:
    assert code(rotation(3000), alike(3000))[1] < 0.6 * code(rotation(3000), any_turns(3000))[1]


@pytest.mark.parametrize("make", [any_turns, alike])
def test_two_quantisers_are_nearer_at_fewer_bytes(make: object) -> None:
    wanted = make(20_000)  # type: ignore[operator]
    alone, size = code(rotation(20_000), wanted)
    both, smaller = code(rotation(20_000, 440, 440, alternating=True), wanted)
    assert smaller < size - 3 * 20_000 * 0.1 / 8

    def error(found: np.ndarray) -> float:
        return float(np.mean(1 - np.abs(relative(found, wanted)).max(axis=1)))

    assert error(both) < error(alone)


def test_spins_may_be_coarser_than_tilts() -> None:
    walk, wanted = rotation(2000, 300, 40_000), any_turns(2000)
    found, size = code(walk, wanted)
    assert size < code(rotation(2000, 300, 300), wanted)[1] - 2000 * 5 / 8
    turn = relative(found, wanted)
    rows = np.arange(2000)
    best = np.abs(turn).argmax(axis=1)
    # the half turns that names differ by
    turn = relative(multiply(found, np.eye(4, dtype=np.int64)[best] * ONE), wanted)
    poles = np.where(walk.is_needle, 1, 3)
    across = np.abs(np.where(np.arange(4) == poles[:, None], 0, turn))[:, 1:].max(axis=1)
    about = np.abs(turn[rows, poles])
    assert across.max() < 0.02
    assert 0.02 < about.max() < 0.35
