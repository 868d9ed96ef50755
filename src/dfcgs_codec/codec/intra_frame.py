"""An I-frame, or the births of a P-frame, from streams to state, graded or not (spec sections 9.3 and 11)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import Grading
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.dpb import FrameState
from dfcgs_codec.codec.graded_intra import GradedShape, GradedTarget, code_graded
from dfcgs_codec.codec.intra import IntraShape, IntraSymbols, code_intra
from dfcgs_codec.codec.reconstruct import reconstruct_intra
from dfcgs_codec.codec.symbols import SymbolCoder

#: what an encoder wants to be coded
IntraTarget = IntraSymbols | GradedTarget


@dataclass(frozen=True)
class IntraCoding:
    """What headers say of how it is coded; `grading` None: all Gaussians have the same steps."""

    shape: IntraShape
    steps: Mapping[Attribute, int]
    grading: Grading | None
    units: UnitExponents

    def code(self, next_coder: Callable[[], SymbolCoder], target: IntraTarget | None) -> FrameState:
        """All its streams; `target`: None when reading; returns the state."""
        if self.grading is None:
            assert not isinstance(target, GradedTarget)
            return reconstruct_intra(code_intra(next_coder, target, self.shape), dict(self.steps))
        assert not isinstance(target, IntraSymbols)
        shape = GradedShape(self.shape, self.steps, self.grading, self.units)
        return code_graded(next_coder, target, shape)
