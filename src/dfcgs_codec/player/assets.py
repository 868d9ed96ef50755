"""What a page needs to decode: the core, and the models that the core knows, as text."""

from __future__ import annotations

import json
from base64 import b64encode
from functools import cache
from typing import Any

from dfcgs_codec.core.module import MODULE
from dfcgs_codec.model.core_words import words_of
from dfcgs_codec.model.registry import DEFAULT_PRIOR, context_model

#: of all models of profile main that the package brings
_MODELS = (DEFAULT_PRIOR,)


def _text(data: bytes) -> str:
    return b64encode(data).decode("ascii")


def _model(model_id: str) -> dict[str, str]:
    model = context_model(model_id)
    words = words_of(model)
    assert words is not None, "models of the package are those of files"
    return {"id": model_id, "hash": model.digest.hex(), "words": _text(words)}


@cache
def assets_json() -> str:
    """`{"core": ..., "models": [{"id", "hash", "words"}]}`; the core and the words in base64."""
    found: dict[str, Any] = {"core": _text(MODULE.read_bytes()), "models": [_model(name) for name in _MODELS]}
    return json.dumps(found)
