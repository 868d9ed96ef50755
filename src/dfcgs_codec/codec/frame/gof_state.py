"""All that encoder and decoder hold after a frame of a GoF."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.frame_headers import ControlHeader, IntraSteps
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.motion.compensation import Carried, ControlSource, GofMotion
from dfcgs_codec.codec.motion.walk import MotionSymbols
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.residual.inputs import gaussian_inputs
from dfcgs_codec.codec.residual.walk import Prior
from dfcgs_codec.codec.state.planes import FrameState, Plane
from dfcgs_codec.codec.state.visibility import Visibility
from dfcgs_codec.model.context_model import ContextModel
from dfcgs_codec.transform.lod import GofLevels
from dfcgs_codec.transform.rotation import round_divide


@dataclass(frozen=True)
class GofState:
    """The decoded `frame`, its levels of detail, the symbols before, control points and their motion.

    `position_step`: that of the I-frame, 1 where it has none; `visibility`: of the frame.
    """

    frame: FrameState
    levels: GofLevels
    control: ControlSource
    position_step: int
    visibility: Visibility
    history: InterSymbols = field(default_factory=InterSymbols)
    moved: GofMotion | None = None
    model: ContextModel | None = None

    @staticmethod
    def of_intra(
        frame: FrameState,
        control: ControlHeader,
        steps: IntraSteps | None,
        units: UnitExponents,
        model: ContextModel | None,
    ) -> GofState:
        """After the GoF's I-frame; `steps`: None where it has none; `model`: the frozen prior."""
        source = ControlSource(frame.planes[Attribute.POSITION], control)
        step = 1 if steps is None else steps.steps[Attribute.POSITION]
        levels = GofLevels(round_divide(frame.planes[Attribute.POSITION].wide(), step))
        visibility = Visibility(frame, units)
        return GofState(frame, levels, source, step, visibility, model=model)

    def motion(self) -> GofMotion:
        """The motion of the GoF so far."""
        return self.moved or self.control.motion

    def prior(self, levels: dict[Attribute, int], moved: MotionSymbols | None) -> Prior:
        """What the frozen prior is told of the next residual: `levels` of visibility steps, who moved."""
        assert self.model is not None
        binding = None if self.moved is None else self.moved.binding
        follows = None if moved is None else moved.follows
        gaussians = gaussian_inputs(binding, follows, self.frame.num_gaussians)
        coarser = {a: self.visibility.coarseness(a, level) for a, level in levels.items()}
        return Prior(self.model, gaussians, coarser)

    def survivors(self, kept: Int64) -> GofState:
        """Without the Gaussians that are not among the rows `kept`."""
        if len(kept) == self.frame.num_gaussians:
            return replace(self, frame=replace(self.frame, verbatim=None))
        frame = self.frame.take(kept)
        return replace(
            self,
            frame=frame,
            visibility=self.visibility.of(frame),
            levels=self.levels.take(kept),
            history=self.history.merged(0, kept),
            moved=self.motion().survivors(kept),
        )

    def after(
        self, frame: FrameState, history: InterSymbols, carried: tuple[Carried, MotionSymbols] | None
    ) -> GofState:
        """After the next `frame`, which the symbols `history` led to, and motion, where it had any."""
        moved = self.moved
        if carried is not None:
            moved = self.motion().after(*carried, (self.frame, frame))
        visibility = self.visibility.of(frame)
        return replace(self, frame=frame, visibility=visibility, history=history, moved=moved)

    def places_of_births(self, births: FrameState) -> Int64:
        """Which row of survivors, then births, stands where: births among those that are near."""
        motion = self.motion()
        cells = motion.cells_of(births.planes[Attribute.POSITION].wide())
        return insertion(motion.keys(), motion.keys_of(cells))

    def with_births(self, births: FrameState, source: Int64) -> GofState:
        """With Gaussians more: row i is row source[i] of those that are there and `births`."""
        motion = self.motion()
        positions = births.planes[Attribute.POSITION].wide()
        cells = motion.cells_of(positions)
        frame = self.frame.merge(births, source)
        return replace(
            self,
            frame=frame,
            visibility=self.visibility.of(frame),
            levels=self.levels.merge(round_divide(positions, self.position_step), source),
            history=self.history.merged(len(positions), source),
            moved=motion.with_births(cells, source),
        )

    def expected_places(self, source: Int64 | None = None) -> Int64:
        """Place in the output of each Gaussian, as they come; births of `source` stand behind all others."""
        count = self.frame.num_gaussians if source is None else len(source)
        if self.frame.order is None:
            return np.arange(count)
        places = self.frame.order.values[:, 0].astype(np.int64)
        if source is None:
            return places
        return np.concatenate([places, np.arange(len(places), count)])[source]

    def in_places(self, places: Int64) -> GofState:
        """With another order of the output."""
        return replace(self, frame=replace(self.frame, order=Plane(places[:, None]), verbatim=None))


def insertion(keys: Int64, births: Int64) -> Int64:
    """Which row of survivors and births stands where: by key, survivors' keys never falling.

    `keys` of survivors (S,), of `births` (B,); returns rows (S + B,) of the former followed by the latter.
    """
    rising = np.maximum.accumulate(keys)
    return np.argsort(np.concatenate([rising, births]), kind="stable").astype(np.int64)
