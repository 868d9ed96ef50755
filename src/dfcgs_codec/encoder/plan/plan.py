"""What is settled before the first frame is coded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from dfcgs_codec.bitstream.constants import Attribute, Profile
from dfcgs_codec.bitstream.frame_headers import ControlHeader
from dfcgs_codec.bitstream.sequence_header import SequenceHeader
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.images.shown import Region, Seen
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.quantiser_steps import Quantisation
from dfcgs_codec.model.registry import context_model


@dataclass(frozen=True)
class SequencePlan:
    """Header, steps and options of a sequence; `anchors[i]` is the first frame of frame i's run.

    `qp`: the one that steps are from; `estimate`: the PSNR of images that they lead to, dB, where it could be
    found. `region`: where viewers stand, if that is known, and what is `seen` of a run, by its first frame;
    `unseen_cost`: what leaving out the rest costs of that PSNR, dB.
    `comments` of the input's PLY files are kept.
    """

    header: SequenceHeader
    quantisation: Quantisation
    options: EncoderOptions
    qp: float
    anchors: list[int]
    estimate: float | None = None
    unseen_cost: float | None = None
    region: Region | None = None
    seen: Mapping[int, Seen] = field(default_factory=dict)
    comments: tuple[bytes, ...] = ()

    @property
    def num_unseen(self) -> int | None:
        """How many Gaussians of the first frame that has any are left out, where cameras say who shows."""
        return self.seen[min(self.seen)].num_left_out if self.seen else None

    def describe(self) -> str:
        """Settings and what was chosen, in one line."""
        parts = [self.options.describe(self.qp)]
        if self.estimate is not None:
            parts.append(f"estimate={self.estimate:.1f}dB")
        if self.num_unseen is not None:
            parts.append(f"unseen={self.num_unseen}")
        if self.unseen_cost is not None:
            parts.append(f"unseen_cost={self.unseen_cost:.2f}dB")
        return " ".join(parts)

    @property
    def steps(self) -> dict[Attribute, int]:
        """Quantiser steps, in grid units."""
        return self.quantisation.steps

    @property
    def control(self) -> ControlHeader:
        """How control points are chosen: a cell is about as wide as a position step."""
        shift = self.steps[Attribute.POSITION].bit_length() - 1
        return ControlHeader(self.options.tuning.control_spacing, shift)

    def writer(self, frame_index: int) -> FrameWriter:
        """For the chunks of a frame, with the frozen prior of profile MAIN."""
        is_main = self.header.profile == Profile.MAIN
        return FrameWriter(self.header, context_model(self.header.model_id) if is_main else None, frame_index)
