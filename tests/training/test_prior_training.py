from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfcgs_codec import decode_sequence, encode_sequence
from dfcgs_codec.errors import InputError
from dfcgs_codec.model import registry
from dfcgs_codec.model.context_model import NUM_CELLS, NUM_FLAG_CLASSES, ContextModel
from lab.options import encoder_options
from lab.small_clouds import all_changing, make_cloud, waving

torch = pytest.importorskip("torch", reason="training needs torch, from the train extra")

from training.prior import tables  # noqa: E402
from training.prior.ablations import GROUPS, masked  # noqa: E402
from training.prior.export import integer_classes, network_arrays, write_model  # noqa: E402
from training.prior.nets import ClassNet, FlagLoss, SymbolLoss  # noqa: E402
from training.prior.recordings import RECORDED, record  # noqa: E402
from training.prior.train import PARTS, Config, load, train  # noqa: E402
from training.prior.untrained import WIDTHS, untrained_arrays  # noqa: E402

SHORT = Config(steps=30, hidden=dict.fromkeys(PARTS, (6,)))


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two small sequences, with motion and with everything changing."""
    folder = tmp_path_factory.mktemp("recordings")
    cloud = make_cloud(1500)
    cloud = replace(cloud, scales=cloud.scales - 3)
    model = ContextModel.of_arrays(RECORDED, untrained_arrays())
    sequences = {
        "waving.28": [waving(cloud, 0.1 * index) for index in range(4)],
        "changing.28": all_changing(make_cloud(300, 1), 4),
    }
    for index, (name, frames) in enumerate(sequences.items()):
        record(frames, 28.0, model, seed=index).save(folder / f"{name}.npz")
    registry._registered.clear()
    return folder


def test_recordings_are_what_a_decoder_sees(recordings: Path) -> None:
    flags, columns, control = (load(recordings, part) for part in PARTS)
    for part, data in zip(PARTS, (flags, columns, control), strict=True):
        assert data["inputs"].shape == (len(data["values"]), sum(WIDTHS[part][:2]))
        assert data["inputs"].dtype == np.uint8
    assert set(flags["values"].tolist()) == {0, 1}
    assert control["values"].any()
    kinds, fractions = columns["cells"].T
    assert set(kinds.tolist()) == {0, 1, 2, 3}
    assert set(fractions.tolist()) <= {0, 1, 2}
    # the last symbol of a Gaussian that has a flag is not zero where all others are
    last = columns["values"][kinds == 3]
    assert (last != 0).mean() > 0.9


def test_training_is_repeatable_and_makes_a_model(recordings: Path, tmp_path: Path) -> None:
    lines: list[str] = []
    arrays = train(recordings, SHORT, lines.append)
    again = train(recordings, SHORT, lines.append)
    assert len(lines) == 2 * len(PARTS)
    assert all(np.array_equal(arrays[name], again[name]) for name in arrays)
    assert sorted(arrays) == sorted(again)
    path = write_model(arrays, tmp_path / "tiny", {"training": {}})
    model = registry.load_model(path)
    assert isinstance(model, ContextModel)
    registry.register(model)
    frames = all_changing(make_cloud(200, 1), 3)
    sizes = {}
    untrained = ContextModel.of_arrays("untrained", untrained_arrays())
    registry.register(untrained)
    for name in ("tiny", "untrained"):
        encode_sequence(frames, tmp_path / name, encoder_options(model_id=name))
        assert len(list(decode_sequence(tmp_path / name))) == len(frames)
        sizes[name] = (tmp_path / name).stat().st_size
    registry._registered.clear()
    assert sizes["tiny"] < sizes["untrained"]


@pytest.mark.parametrize("name", PARTS)
def test_the_integers_are_the_floats_to_a_class(name: str) -> None:
    torch.manual_seed(2)
    width = sum(WIDTHS[name][:2])
    net = ClassNet(width, (12, 12))
    inputs = np.random.default_rng(0).integers(0, 120, (500, width)).astype(np.uint8)
    with torch.no_grad():
        found = net(torch.from_numpy(inputs).float())
    expected = (FlagLoss if name == "flags" else SymbolLoss).classes(found).numpy()
    classes = integer_classes(network_arrays(net, name), name, inputs)
    assert np.abs(classes - expected).max() <= 1
    assert (classes == expected).mean() > 0.97


def test_what_is_masked_is_not_looked_at() -> None:
    columns = masked(["temporal", "spatial"])
    assert set(columns["flags"]) == set(GROUPS["temporal"]["flags"]) | set(GROUPS["spatial"]["flags"])
    with pytest.raises(InputError, match="'colour'"):
        masked(["colour"])
    width = sum(WIDTHS["flags"][:2])
    mask = torch.ones(width)
    mask[list(columns["flags"])] = 0
    net = ClassNet(width, (8,), mask)
    inputs = np.random.default_rng(0).integers(0, 200, (50, width)).astype(np.uint8)
    other = inputs.copy()
    other[:, list(columns["flags"])] = 7
    arrays = network_arrays(net, "flags")
    assert np.array_equal(integer_classes(arrays, "flags", inputs), integer_classes(arrays, "flags", other))


def test_groups_of_inputs_do_not_overlap() -> None:
    for part in PARTS:
        columns = [c for group in GROUPS.values() for c in group.get(part, ())]
        assert len(columns) == len(set(columns))
        assert max(columns) < sum(WIDTHS[part][:2])


def test_tables_follow_what_was_counted() -> None:
    rng = np.random.default_rng(1)
    count = 40_000
    # one class, kind 3: never zero
    classes = np.full(count, 8, np.int64)
    cells = np.stack([np.full(count, 3), np.zeros(count, np.int64)], axis=1)
    values = rng.choice([-2, -1, 1, 2], count)
    found, frequencies = tables.symbol_tables(classes, cells, values)
    assert found.shape == (NUM_CELLS,)
    own = [cell for cell in range(NUM_CELLS) if found[cell] < 0]
    assert len(own) == len(frequencies) == 1
    share = frequencies[0] / (1 << 24)
    assert share[15] < 0.01
    assert abs(share[16] - 0.25) < 0.01


def test_frequencies_of_flags_rise_with_the_class() -> None:
    rng = np.random.default_rng(1)
    classes = rng.integers(0, NUM_FLAG_CLASSES, 5000)
    values = (rng.random(5000) < classes / NUM_FLAG_CLASSES).astype(np.int64)
    frequencies = tables.flag_frequencies(classes, values)
    assert np.array_equal(frequencies.sum(axis=1), np.full(NUM_FLAG_CLASSES, 1 << 24))
    assert frequencies[2, 1] < frequencies[16, 1] < frequencies[30, 1]
