"""What the package promises to its users."""

from __future__ import annotations

import re

import pytest

import dfcgs_codec
from dfcgs_codec import errors

PUBLIC = {
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
}


def test_all_is_pinned() -> None:
    assert set(dfcgs_codec.__all__) == PUBLIC
    assert len(dfcgs_codec.__all__) == len(PUBLIC)


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_each_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(dfcgs_codec, name)
    assert name == "__version__" or value.__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'encode'"):
        dfcgs_codec.encode


def test_version_is_a_release_number() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", dfcgs_codec.__version__)


def test_error_codes_are_stable_and_distinct() -> None:
    classes = [c for c in vars(errors).values() if isinstance(c, type) and issubclass(c, errors.DfcgsError)]
    codes = {c.__name__: c.code for c in classes}
    assert codes == {
        "DfcgsError": "error",
        "BitstreamError": "bitstream",
        "NotADgsFile": "not-a-dgs-file",
        "UnsupportedBitstream": "unsupported",
        "ModelMismatch": "model-mismatch",
        "TruncatedBitstream": "truncated",
        "CorruptBitstream": "corrupt",
        "LimitExceeded": "limit",
        "ResourceLimit": "resources",
        "InputError": "input",
        "VerificationError": "verification",
    }
