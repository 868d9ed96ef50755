"""The frozen prior of profile `main` as the words that the core reads (core/context_model.h)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from dfcgs_codec.entropy.coder import Model
from dfcgs_codec.model.context_model import ClassNetwork, ContextModel, FlagPart, SymbolPart

AnyArray = npt.NDArray[np.integer] | npt.NDArray[np.floating]


def _network(network: ClassNetwork) -> Iterator[AnyArray]:
    yield np.array([len(network.layers)])
    for layer in network.layers:
        yield np.array([*layer.weight.shape, layer.shift, layer.limit])
        yield layer.bias
        yield layer.weight


def _models(models: Sequence[Model]) -> Iterator[AnyArray]:
    for model in models:
        yield model.frequencies


def _tables(part: SymbolPart) -> Iterator[AnyArray]:
    yield part.tables
    yield np.array([len(part.models)])
    yield from _models(part.models)


def words_of(model: ContextModel) -> bytes | None:
    """Little-endian int32; None for a model whose parts are not those of a file."""
    flags, columns, control = model.flags, model.columns, model.control
    if not (
        isinstance(flags, FlagPart) and isinstance(columns, SymbolPart) and isinstance(control, SymbolPart)
    ):
        return None
    arrays = [
        *(array for part in (flags, columns, control) for array in _network(part.network)),
        *_models(flags.models),
        *_models(model.densities),
        model.magnitudes,
        model.control_weights,
        *_tables(columns),
        *_tables(control),
    ]
    return np.concatenate([np.ravel(array) for array in arrays]).astype("<i4").tobytes()
