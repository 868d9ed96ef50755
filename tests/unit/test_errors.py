from __future__ import annotations

import inspect

from dfcgs_codec import errors

TREE = {
    "BitstreamError": ("DfcgsError", "bitstream"),
    "NotADgsFile": ("BitstreamError", "not-a-dgs-file"),
    "UnsupportedBitstream": ("BitstreamError", "unsupported"),
    "ModelMismatch": ("BitstreamError", "model-mismatch"),
    "TruncatedBitstream": ("BitstreamError", "truncated"),
    "CorruptBitstream": ("BitstreamError", "corrupt"),
    "LimitExceeded": ("BitstreamError", "limit"),
    "ResourceLimit": ("LimitExceeded", "resources"),
    "InputError": ("DfcgsError", "input"),
    "VerificationError": ("DfcgsError", "verification"),
}


def test_the_tree_and_its_codes_are_stable() -> None:
    classes = dict(inspect.getmembers(errors, inspect.isclass))
    found = {name: (c.__base__.__name__, c.code) for name, c in classes.items() if name != "DfcgsError"}
    assert found == TREE


def test_the_message_ends_with_the_byte() -> None:
    error = errors.CorruptBitstream("wrong", offset=12)
    assert (str(error), error.offset) == ("wrong (byte 12)", 12)
    assert str(errors.CorruptBitstream("wrong")) == "wrong"
