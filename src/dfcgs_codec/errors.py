"""The errors of the codec: one drawn tree, each with a stable code.

DfcgsError
  BitstreamError          exit code 3: the file is refused
    NotADgsFile           the first bytes are not ours
    UnsupportedBitstream  ours, but of a version, profile or critical chunk this build cannot read
    ModelMismatch         coded with weights that are not installed
    TruncatedBitstream    the file ends too early
    CorruptBitstream      a checksum, a count or a hash does not fit
    LimitExceeded         a count is above the limit of the level
      ResourceLimit       more memory or work than the caller allows; a legal file, perhaps
  InputError              exit code 1: the PLY files or the arguments cannot be coded
  VerificationError       exit code 1: decoder and encoder disagree; always a codec bug
"""

from __future__ import annotations

from dfcgs_codec.spelling import spelled


class DfcgsError(Exception):
    """Base of all errors; `code` is stable across releases, `offset` a byte position or None.

    Messages are written with the options of the command line; `str` calls them as Python does, outside it.
    """

    code = "error"

    def __init__(self, message: str, *, offset: int | None = None) -> None:
        self.offset = offset
        super().__init__(message if offset is None else f"{message} (byte {offset})")

    def __str__(self) -> str:
        return spelled(super().__str__())


class BitstreamError(DfcgsError):
    """A `.dgs` file that this decoder refuses."""

    code = "bitstream"


class NotADgsFile(BitstreamError):
    """The magic number is missing."""

    code = "not-a-dgs-file"


class UnsupportedBitstream(BitstreamError):
    """A legal file that needs a newer or another decoder."""

    code = "unsupported"


class ModelMismatch(BitstreamError):
    """The stream names model weights other than those installed."""

    code = "model-mismatch"


class TruncatedBitstream(BitstreamError):
    """The file ends before its end record."""

    code = "truncated"


class CorruptBitstream(BitstreamError):
    """A checksum, hash, count or structure is wrong."""

    code = "corrupt"


class LimitExceeded(BitstreamError):
    """A count exceeds the limits of the declared level."""

    code = "limit"


class ResourceLimit(LimitExceeded):
    """A file that asks for more than the caller's `DecoderLimits` allow.

    `what` is the message without advice; with `value` in its field `field` the limits would have allowed it.
    """

    code = "resources"

    def __init__(self, what: str, field: str, value: int, advice: str | None = None) -> None:
        self.what, self.field, self.value = what, field, value
        super().__init__(f"{what}; {advice or f'DecoderLimits({field}={value}) allows it'}")


class InputError(DfcgsError):
    """Input that cannot be coded; the message says what to do."""

    code = "input"


class VerificationError(DfcgsError):
    """The decoder's output differs from the encoder's reconstruction: a bug in the codec."""

    code = "verification"
