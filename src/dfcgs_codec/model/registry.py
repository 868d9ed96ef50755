"""Which models there are: those of the package, and those that somebody registered (spec section 16.1)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from dfcgs_codec.bitstream.constants import MODEL_HASH_BYTES
from dfcgs_codec.errors import ModelMismatch
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.model.latent_model import LatentModel
from dfcgs_codec.model.weights_file import ENDING, read_arrays

#: what `dfcgs encode --profile paper` uses
DEFAULT_MODEL = "paper-1"
_WEIGHTS = Path(__file__).with_name("weights")
#: what `dfcgs encode` uses otherwise
DEFAULT_PRIOR = "main-1"
#: a model of profile PAPER, or a prior of profile MAIN
AnyModel = LatentModel | ContextModel
_registered: dict[str, AnyModel] = {}


def load_model(path: Path) -> AnyModel:
    """The model of a file; its id is the file's name. LayerError where it is none."""
    arrays = read_arrays(path)
    if "columns.tables" in arrays:
        return ContextModel.of_arrays(path.stem, arrays)
    return LatentModel.of_arrays(path.stem, arrays)


@cache
def _of_package(model_id: str) -> AnyModel | None:
    # names come from files that anybody may have made: compared, never put into a path
    found = {path.stem: path for path in sorted(_WEIGHTS.glob(f"*{ENDING}"))}
    return load_model(found[model_id]) if model_id in found else None


def register(model: AnyModel) -> None:
    """Make a model known that the package does not bring: experiments; replaces one of the same id."""
    _registered[model.model_id] = model


def installed(model_id: str) -> AnyModel:
    """The model of that id; ModelMismatch where there is none."""
    model = _registered.get(model_id) or _of_package(model_id)
    if model is None:
        raise ModelMismatch(
            f"model {model_id!r} is not installed: another version of the package may have it"
        )
    return model


def latent_model(model_id: str) -> LatentModel:
    """The model of profile PAPER of that id; ModelMismatch where there is none."""
    model = installed(model_id)
    if not isinstance(model, LatentModel):
        raise ModelMismatch(f"model {model_id!r} is not one of profile paper")
    return model


def context_model(model_id: str) -> ContextModel:
    """The prior of profile MAIN of that id; ModelMismatch where there is none."""
    model = installed(model_id)
    if not isinstance(model, ContextModel):
        raise ModelMismatch(f"model {model_id!r} is not one of profile main")
    return model


def model_of_stream(model_id: str, model_hash: bytes) -> AnyModel:
    """The model that a stream names; ModelMismatch unless its weights are the very same."""
    model = installed(model_id)
    if model.digest[:MODEL_HASH_BYTES] != model_hash:
        raise ModelMismatch(
            f"coded with model {model_id!r} of hash {model_hash.hex()}, installed is one of "
            f"{model.digest[:MODEL_HASH_BYTES].hex()}: another version of the package has it"
        )
    return model
