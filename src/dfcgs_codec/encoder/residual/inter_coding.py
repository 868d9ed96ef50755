"""P-frames: topology, motion and residual of a frame, each where it pays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dfcgs_codec.array_types import Int64
from dfcgs_codec.bitstream.constants import Attribute, OutputOrder
from dfcgs_codec.bitstream.frame_headers import IntraSteps
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.topology import TopologyGoal
from dfcgs_codec.codec.frame.walk import MotionGoal
from dfcgs_codec.codec.residual.classes import InterSymbols, nonzero_rows
from dfcgs_codec.codec.state.visibility import Visibility
from dfcgs_codec.encoder.frame.frame_coding import CodedFrame, coded_inter, topology_goal
from dfcgs_codec.encoder.frame.reference import InputFrame
from dfcgs_codec.encoder.frame.targets import ordered
from dfcgs_codec.encoder.intra.intra_plan import IntraPlan, IntraTarget, inter_levels, steps_in_intra_frame
from dfcgs_codec.encoder.matching.canonical import choose_axis_names
from dfcgs_codec.encoder.matching.identity import Members, Succession
from dfcgs_codec.encoder.motion.motion_choice import choose_motion
from dfcgs_codec.encoder.motion.motion_judge import MotionTask
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.tuning import MotionMode
from dfcgs_codec.encoder.residual.quantise import (
    SLACK,
    Planes,
    ResidualQuantiser,
    ZeroBin,
    inter_symbols,
)


@dataclass(frozen=True)
class Births:
    """A change of topology, and the Gaussians that come with it."""

    change: TopologyGoal
    members: Members
    target: Planes

    def __len__(self) -> int:
        return len(self.members.rows)


@dataclass(frozen=True)
class InterTask:
    """A P-frame to be coded: `target` of the survivors, what it was `before`, the `state` they are in.

    `reference`: the state with those that go.
    """

    index: int
    target: Planes
    before: Planes
    state: GofState
    reference: GofState
    births: Births | None


class InterCoder:
    """Codes P-frames of a sequence."""

    def __init__(self, plan: SequencePlan) -> None:
        self._plan = plan
        self._quantisation, self._slack_share = plan.quantisation, SLACK
        self._intra_steps: IntraSteps | None = None
        self._known_slack: tuple[Visibility, dict[Attribute, Int64]] | None = None
        self._known_levels: tuple[Visibility, dict[Attribute, int]] | None = None

    def begin(self, steps: IntraSteps) -> None:
        """A GoF begins, with a coded I-frame that has these steps."""
        self._intra_steps, self._known_slack = steps, None

    def code(self, task: InterTask, finer: float = 0.0) -> CodedFrame:
        """With motion where it seems to pay; steps are `finer` by so many octaves than planned."""
        self._quantisation, self._slack_share = self._plan.quantisation.finer(finer), SLACK * 2.0**-finer
        return self._coded(task, self._motion(task))

    def births(self, succession: Succession, frame: InputFrame, state: GofState) -> Births | None:
        """The change of topology since `state`, or None where all go on."""
        options, rows = self._plan.options, succession.births
        if succession.all_survive and not len(rows):
            in_place = np.array_equal(succession.members.rows, state.expected_places())
            if in_place or options.order != OutputOrder.INPUT:
                return None
        task, target = None, {}
        names = None
        if len(rows):
            born = ordered(frame.planes, rows)
            if succession.members.names is not None:
                names = choose_axis_names(born)
                born = names.rename(born)
            cover = None if frame.cover is None else frame.cover[rows]
            order, task = self._births(born, cover, keeps_names=names is None)
            rows, target = rows[order], ordered(born, order)
            names = None if names is None else names.take(order)
        inputs = None
        if options.order == OutputOrder.INPUT:
            inputs = np.concatenate([succession.members.rows, rows])
        change = topology_goal(succession.kept, succession.num_before, task, inputs)
        return Births(change, Members(rows, names), target)

    def _births(self, born: Planes, cover: Int64 | None, *, keeps_names: bool) -> tuple[Int64, IntraTarget]:
        """Canonical order of Gaussians that come, `born` in the input's, and how they are coded."""
        quantisation, zero_bin = self._plan.quantisation, self._plan.options.tuning.intra_zero_bin
        intra = IntraPlan.of(born, cover, quantisation)
        order, grid = intra.order(born[Attribute.POSITION])
        wanted = intra.target(ordered(born, order), (order, grid), quantisation, zero_bin)
        return order, replace(wanted, keeps_names=keeps_names)

    def _coded(self, task: InterTask, trial: MotionGoal | None) -> CodedFrame:
        quantisation, tuning = self._quantisation, self._plan.options.tuning
        reference = task.state.frame
        levels = self._levels(task.state.visibility)
        multipliers = task.state.visibility.all_multipliers(levels)
        slack, share = self.slack(task.state), self._slack_share
        quantiser = ResidualQuantiser(quantisation, ZeroBin(tuning.zero_bin), multipliers, slack, share)
        states = (reference, reference if trial is None else trial.carried.state)
        symbols = InterSymbols()
        if tuning.motion != MotionMode.ONLY:
            symbols = inter_symbols(task.target, task.before, states, quantiser)
        change = None if task.births is None else task.births.change
        steps = quantisation.steps, levels
        return coded_inter(self._plan.writer(task.index), symbols, task.reference, steps, trial, change)

    def _levels(self, visibility: Visibility) -> dict[Attribute, int]:
        """Weights at which steps are as given: few Gaussians show more; bounded steps are so for all."""
        known = self._known_levels
        if known is None or known[0] is not visibility:
            steps, bounded = self._plan.steps, self._plan.quantisation.bounded
            levels = {}
            if self._plan.options.tuning.visibility and len(bounded) < len(steps):
                levels = inter_levels(visibility, steps, bounded)
            known = self._known_levels = (visibility, levels)
        return known[1]

    def slack(self, state: GofState) -> dict[Attribute, Int64]:
        """Steps that the Gaussians had in a coded I-frame: errors that these left are not mended now."""
        if self._intra_steps is None:
            return {}
        known = self._known_slack
        if known is None or known[0] is not state.visibility:
            units = self._plan.quantisation.units
            found = steps_in_intra_frame(state.frame, units, self._intra_steps)
            free = found.keys() - self._plan.quantisation.bounded
            known = self._known_slack = (state.visibility, {a: found[a] for a in free})
        return known[1]

    def _motion(self, task: InterTask) -> MotionGoal | None:
        tuning = self._plan.options.tuning
        mode = tuning.motion
        if mode == MotionMode.OFF:
            return None
        moving = (Attribute.POSITION, Attribute.ROTATION)
        changed = np.logical_or(*(nonzero_rows(task.target[a] - task.before[a]) for a in moving))
        if not changed.any():
            return None
        state = task.state
        levels = self._levels(state.visibility)
        multipliers = state.visibility.all_multipliers({a: levels[a] for a in moving if a in levels})
        motion_task = MotionTask(
            state.motion(),
            state.frame,
            task.target,
            changed,
            self._quantisation.steps,
            multipliers,
            mode != MotionMode.ONLY,
            state.model,
            tuning.turns,
        )
        return choose_motion(motion_task)
