"""Which streams take the frozen prior: both ways are tried now and then, the better one stays."""

from __future__ import annotations

from enum import Enum

from dfcgs_codec.bitstream.constants import Attribute


class PriorMode(Enum):
    """Whether streams of P-frames take the frozen prior of profile MAIN."""

    #: where that takes fewer bytes
    AUTO = "auto"
    #: never; the file names no model
    PLAIN = "plain"
    #: everywhere
    NETWORK = "network"


#: frames after which both ways are tried again, where the prior did better, and where it did not: its memory
#: makes it better with time
_PERIOD = 8
_PLAIN_PERIOD = 4


class PriorChoice:
    """What did better for the streams of a GoF, by attribute; None stands for control points."""

    def __init__(self, mode: PriorMode) -> None:
        self._mode = mode
        self._known: dict[Attribute | None, tuple[bool, int]] = {}

    def preferred(self, stream: Attribute | None) -> bool | None:
        """The way to code the stream, None to try both."""
        if self._mode != PriorMode.AUTO:
            return self._mode == PriorMode.NETWORK
        known, age = self._known.get(stream, (True, _PERIOD))
        return None if age >= (_PERIOD if known else _PLAIN_PERIOD) else known

    def learn(self, stream: Attribute | None, with_prior: bool | None) -> None:
        """How it was coded in the end."""
        tried = self.preferred(stream) is None
        if with_prior is not None and self._mode == PriorMode.AUTO:
            age = 0 if tried else self._known[stream][1]
            self._known[stream] = (with_prior, age + 1)
