"""The exported integers: numpy, torch and the codec's own runtime agree, and stand for the float networks."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch, from the train extra")

latent_model = pytest.importorskip("dfcgs_codec.model.latent_model", reason="the runtime is not there")
weights_file = pytest.importorskip("dfcgs_codec.model.weights_file", reason="the runtime is not there")


from tests.training.paper_helpers import small_data, small_gof  # noqa: E402
from training.paper.config import Config  # noqa: E402
from training.paper.data import Data  # noqa: E402
from training.paper.export import export_run, hyper_frequencies  # noqa: E402
from training.paper.factorised import FactorisedModel  # noqa: E402
from training.paper.inputs import grid_corners, interpolate  # noqa: E402
from training.paper.integers import (  # noqa: E402
    IntegerLayer,
    IntegerModel,
    evaluate_numpy,
    evaluate_torch,
    layers_of,
)
from training.paper.nets import SHAPES  # noqa: E402
from training.paper.report import gof_figures  # noqa: E402
from training.paper.train import Run, train  # noqa: E402


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    data = Data(small_data(folder))
    run = train(Run.new(Config(seed=3, warm_up=150, geometry=10, rendering=0, batch=1)), data)
    with torch.no_grad():
        # as if they had been trained: what is there must also be large
        run.model.nets["refinement"].layers[-1].weight.normal_(0, 0.1)
        run.model.grid *= 10
    path = export_run(run, data, folder / "models" / "test-1")
    return run, path, weights_file.read_arrays(path)


def extreme_inputs(width, limit, seed=0):
    rng = np.random.default_rng(seed)
    rows = [
        rng.integers(-limit, limit + 1, (200, width)),
        rng.choice([-limit, limit], (200, width)),
        rng.integers(-3, 4, (50, width)),
        np.zeros((1, width), np.int64),
    ]
    return np.concatenate(rows)


@pytest.mark.parametrize("name", SHAPES)
def test_numpy_torch_and_runtime_agree(exported, name):
    _, path, arrays = exported
    layers = layers_of(arrays, name)
    inputs = extreme_inputs(SHAPES[name].widths[0], 32767)
    expected = evaluate_numpy(layers, inputs)
    by_torch = evaluate_torch(layers, torch.from_numpy(inputs.astype(np.float64))).numpy()
    runtime = latent_model.LatentModel.of_arrays(path.stem, arrays).networks[name]
    assert np.array_equal(by_torch, expected)
    assert np.array_equal(runtime(inputs), expected)
    assert np.abs(expected).max() > 0


def test_a_layer_floors_clips_and_leaks():
    layer = IntegerLayer(np.array([[1], [-1], [100]], np.int16), np.array([0, 0, 5]), 1, 100, True)
    found = evaluate_numpy([layer], np.array([[3], [-301]]))
    assert found.tolist() == [[1, -1, 100], [-1, 100, -1]]
    assert layer.largest_sum(10) == 1005


def test_the_grid_is_read_as_the_runtime_reads_it(exported):
    _, path, arrays = exported
    places = extreme_inputs(3, 1 << 17, seed=4)
    runtime = latent_model.LatentModel.of_arrays(path.stem, arrays).grid.read(places)
    integer = IntegerModel(arrays).interpolated(grid_corners(torch.from_numpy(places)))
    assert np.array_equal(np.rint(integer.numpy() * 4096), runtime)
    grid = torch.from_numpy(arrays["grid"].astype(np.float32) / 64)
    exact = interpolate(grid, *grid_corners(torch.from_numpy(places))).numpy() * 4096
    assert np.abs(exact - runtime).max() <= 1.01
    assert np.abs(runtime).max() > 100


def test_the_prior_is_that_of_the_runtime(exported):
    _, path, arrays = exported
    places, look = extreme_inputs(3, 1 << 15, seed=5), extreme_inputs(56, 32767, seed=6)
    runtime = latent_model.LatentModel.of_arrays(path.stem, arrays).prior(
        latent_model.PriorInputs(places, look)
    )
    columns = torch.from_numpy((look / 4096).astype(np.float32))
    found = IntegerModel(arrays).prior(grid_corners(torch.from_numpy(places)), columns)
    assert np.array_equal(np.rint(found.numpy() * 1024), runtime)


def inputs_seen(model):
    """What each network is given while a GoF is coded."""
    seen = {}
    hooks = [
        net.register_forward_pre_hook(lambda _, inputs, name=name: seen.setdefault(name, inputs[0].detach()))
        for name, net in model.nets.items()
    ]
    gof_figures(model, small_gof(0), 1.0)
    for hook in hooks:
        hook.remove()
    return {**seen, "refinement": seen["fusion"][:, 16:]}


def test_integers_stand_for_the_float_networks(exported):
    run, _, arrays = exported
    integer = IntegerModel(arrays)
    seen = inputs_seen(run.model)
    assert set(seen) == set(SHAPES)
    for name, inputs in seen.items():
        with torch.no_grad():
            expected, found = run.model.nets[name](inputs), integer.nets[name](inputs)
        error, size = float((found - expected).abs().mean()), float(expected.abs().mean())
        # results are multiples of 1/1024, and a network that is hardly trained says hardly more than that
        assert error < 0.02 * size + 0.5 / 1024, f"{name}: {error} of {size}"


def test_coding_with_integers_costs_about_what_the_float_networks_say(exported):
    run, _, arrays = exported
    # a single GoF has some 300 bits: rounding alone moves them by a few in a hundred
    gofs = [small_gof(seed) for seed in range(4)]
    expected, found = ([gof_figures(m, g, 1.0) for g in gofs] for m in (run.model, IntegerModel(arrays)))
    assert _bits(found) == pytest.approx(_bits(expected), rel=0.03)
    for one, other in zip(found, expected, strict=True):
        assert one["reached_ratio"] == pytest.approx(other["reached_ratio"], rel=0.05)


def _bits(figures):
    return sum(f["motion_bits"] + f["hyper_bits"] for f in figures)


def test_the_file_keeps_to_the_format(exported):
    _, path, arrays = exported
    assert arrays["grid"].dtype == np.int8
    assert arrays["grid"].shape == (6, 4096, 4)
    frequencies = arrays["hyper_frequencies"]
    assert frequencies.shape == (16, 63)
    assert (frequencies.sum(axis=1) == 1 << 24).all()
    assert frequencies.min() >= 1
    assert path.stat().st_size + path.with_suffix(".json").stat().st_size < 1 << 20
    for name in SHAPES:
        layers = layers_of(arrays, name)
        assert [len(layer.bias) for layer in layers] == list(SHAPES[name].widths[1:])
        assert [layer.leaky for layer in layers] == [True] * (len(layers) - 1) + [False]


def test_frequencies_follow_the_factorised_model():
    torch.manual_seed(0)
    model = FactorisedModel(16)
    frequencies = hyper_frequencies(model)
    values = torch.arange(-5.0, 6.0)[:, None].expand(11, 16)
    bits = model.bits(values).detach().numpy()
    assert np.allclose(24 - np.log2(frequencies[:, 26:37]).T, bits, atol=0.01)


def test_fewer_bits_lose_more(exported, tmp_path):
    run, path, arrays = exported
    data = Data(path.parents[1])
    coarse = weights_file.read_arrays(export_run(run, data, tmp_path / "coarse", (8, 8)))
    inputs = inputs_seen(run.model)["analysis"]
    with torch.no_grad():
        exact = run.model.nets["analysis"](inputs)
    fine_error, coarse_error = (
        (IntegerModel(a).nets["analysis"](inputs) - exact).abs().mean() for a in (arrays, coarse)
    )
    assert coarse_error > 5 * fine_error
    assert np.abs(coarse["analysis.1.weight"]).max() <= 127
    assert coarse["analysis.1.scale"][1] == 127


def test_only_a_part_may_have_fewer_bits(exported, tmp_path):
    run, path, arrays = exported
    data = Data(path.parents[1])
    coarse = weights_file.read_arrays(export_run(run, data, tmp_path / "part", (8, 10), "entropy"))
    differs = {name.split(".")[0] for name in arrays if not np.array_equal(arrays[name], coarse[name])}
    assert differs == {"hyper_synthesis", "grid_context", "appearance", "fusion"}
    assert np.abs(coarse["fusion.1.weight"]).max() <= 127
    assert coarse["fusion.1.scale"][1] == 511
