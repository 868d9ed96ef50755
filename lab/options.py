"""Encoder options by name, whether they are users' or experiments'."""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from dataclasses import replace
from typing import Any

from dfcgs_codec import EncoderOptions, EncoderTuning


def encoder_options(base: EncoderOptions | None = None, **fields: Any) -> EncoderOptions:
    """`base`, or the defaults, with other fields: those of EncoderOptions and of EncoderTuning alike."""
    tuned = {f.name: fields.pop(f.name) for f in dataclass_fields(EncoderTuning) if f.name in fields}
    return replace(base or EncoderOptions(), **fields).tuned(**tuned)
