"""A codec for sequences of 3D Gaussian Splatting frames.

    encode_sequence(folder, "out.dgs")      PLY folder (or GaussianClouds) -> one file
    open_folder(folder, ...)                for encode_sequence: which PLYs, and what of odd ones
    decode_sequence("out.dgs")              -> frames, one after the other
    probe("out.dgs")                        what is in it, from the headers alone

Names are loaded when they are used, so that a decoder never loads the encoder.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dfcgs_codec._version import __version__
from dfcgs_codec.errors import (
    BitstreamError,
    CorruptBitstream,
    DfcgsError,
    InputError,
    LimitExceeded,
    ModelMismatch,
    NotADgsFile,
    ResourceLimit,
    TruncatedBitstream,
    UnsupportedBitstream,
    VerificationError,
)

if TYPE_CHECKING:
    from dfcgs_codec.api import decode_sequence, encode_sequence
    from dfcgs_codec.codec.frame.limits import DecoderLimits
    from dfcgs_codec.codec.frame.probe import probe
    from dfcgs_codec.encoder.plan.options import EncoderOptions
    from dfcgs_codec.encoder.plan.quantiser_steps import Bound
    from dfcgs_codec.encoder.plan.tuning import EncoderTuning
    from dfcgs_codec.gaussians import GaussianCloud
    from dfcgs_codec.ply import InputPolicy
    from dfcgs_codec.sequence import open_folder

_LAZY = {
    "encode_sequence": "dfcgs_codec.api",
    "decode_sequence": "dfcgs_codec.api",
    "probe": "dfcgs_codec.codec.frame.probe",
    "DecoderLimits": "dfcgs_codec.codec.frame.limits",
    "EncoderOptions": "dfcgs_codec.encoder.plan.options",
    "EncoderTuning": "dfcgs_codec.encoder.plan.tuning",
    "Bound": "dfcgs_codec.encoder.plan.quantiser_steps",
    "GaussianCloud": "dfcgs_codec.gaussians",
    "InputPolicy": "dfcgs_codec.ply",
    "open_folder": "dfcgs_codec.sequence",
}

__all__ = [
    "BitstreamError",
    "Bound",
    "CorruptBitstream",
    "DecoderLimits",
    "DfcgsError",
    "EncoderOptions",
    "EncoderTuning",
    "GaussianCloud",
    "InputError",
    "InputPolicy",
    "LimitExceeded",
    "ModelMismatch",
    "NotADgsFile",
    "ResourceLimit",
    "TruncatedBitstream",
    "UnsupportedBitstream",
    "VerificationError",
    "__version__",
    "decode_sequence",
    "encode_sequence",
    "open_folder",
    "probe",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
