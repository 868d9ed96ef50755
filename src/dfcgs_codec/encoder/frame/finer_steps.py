"""P-frames that are not far behind I-frames: where they are, in finer steps, or an I-frame in their place."""

from __future__ import annotations

from collections.abc import Callable

from dfcgs_codec.encoder.frame.reference import CodedReference
from dfcgs_codec.encoder.images.watch import Watch
from dfcgs_codec.encoder.plan.plan import SequencePlan

#: dB by which a P-frame may be behind an I-frame in its place, and are to be; what is further behind is coded
#: again, in finer steps. The frames that follow go part of the way
_MOST_BEHIND, _AIM_BEHIND = 1.2, 0.3
_FOLLOWED = 0.4
#: finer steps have helped that take this share of it away; what does not help was never coded, but appeared
_HELPED = 0.25
#: if it is so many dB behind
_APPEARED = 2.5
_DB_PER_OCTAVE = 6.02
_MOST_FINER = 3.0


class FinerSteps:
    """The loop over the frames of a run; steps of P-frames are finer by so many `octaves` than planned."""

    def __init__(self, plan: SequencePlan) -> None:
        self._watch = Watch(plan)
        self.octaves = 0.0

    def begin(self, loop: CodedReference) -> None:
        """A GoF begins with an I-frame."""
        self._watch.begin(loop.target, loop.coded.state.frame, loop.intra_steps)

    @property
    def level(self) -> float:
        """By how many dB the last frames were worse than I-frames in their place."""
        return self._watch.level

    def good_enough(
        self, index: int, loop: CodedReference, inter: Callable[[], CodedReference], intra_bytes: int
    ) -> CodedReference | None:
        """The P-frame `loop`, or what `inter` makes of it in finer steps; None: an I-frame is better."""
        found = self._watch.behind(loop.target, loop.coded.state.frame, index)
        behind, short = found, max(found, self._watch.short())
        if short > _MOST_BEHIND:
            planned = self.octaves
            self.octaves = min(planned + (short - _AIM_BEHIND) / _DB_PER_OCTAVE, _MOST_FINER)
            loop = inter()
            behind = self._watch.behind(loop.target, loop.coded.state.frame, index)
            helped = found - behind > _HELPED * found
            if (behind > _APPEARED and not helped) or len(loop.coded.data) > intra_bytes:
                # finer steps did not help: the GoF that begins does without
                self.octaves = planned
                return None
        self._watch.go_on()
        change = _FOLLOWED * (max(behind, self._watch.short()) - _AIM_BEHIND) / _DB_PER_OCTAVE
        self.octaves = min(max(self.octaves + change, 0.0), _MOST_FINER)
        return loop
