"""P-frames of profile `paper`: motion of control points through the network (spec annex B)."""

from __future__ import annotations

import numpy as np

from dfcgs_codec.array_types import Float64, Int64, Integers
from dfcgs_codec.bitstream.constants import (
    MAX_DECAY_EXPONENT,
    ROTATION_FRACTION_BITS,
    Attribute,
    Tool,
)
from dfcgs_codec.bitstream.frame_headers import InterHeader
from dfcgs_codec.bitstream.motion_header import LatentHeader, SpreadHeader
from dfcgs_codec.codec.frame.gof_state import GofState
from dfcgs_codec.codec.frame.walk import code_inter_header
from dfcgs_codec.codec.paper.latent_motion import LatentReference
from dfcgs_codec.codec.paper.walk import LatentGoal, code_latent_motion
from dfcgs_codec.codec.residual.classes import InterSymbols
from dfcgs_codec.codec.state.planes import SH_BANDS, FrameState
from dfcgs_codec.encoder.frame.chunk_writer import FrameWriter
from dfcgs_codec.encoder.frame.frame_coding import CodedFrame
from dfcgs_codec.encoder.plan.plan import SequencePlan
from dfcgs_codec.encoder.plan.tuning import RefinementMode
from dfcgs_codec.encoder.residual.quantise import Planes
from dfcgs_codec.model.latent_model import LATENT_BITS, LatentModel
from dfcgs_codec.model.layers import ACTIVATION_LIMIT
from dfcgs_codec.transform.normalisation import NORMAL_BITS

#: octaves of FreqEnc, and fraction bits of its sines
_OCTAVES = 12
_SINE_BITS = 12
#: what P-frames of the profile carry
CARRIED = (Attribute.POSITION, Attribute.ROTATION)
#: a quaternion changes by half the angle, in 2**-24
_HALF_ANGLE = 1 << (ROTATION_FRACTION_BITS - 1)
#: motion mends at least so many times what it spoils
_LEAST_GAIN = 2.0
#: so that no float overflows: octaves of visibility, and magnitude of log-scales
_MAX_WEIGHT, _MAX_LOG_SCALE = 256.0, 100.0


def frequency_encoding(values: Float64) -> Int64:
    """FreqEnc of `values` (n, C): sines, then cosines, of pi 2**o v for each octave o; 12 fraction bits."""
    columns = []
    for octave in range(_OCTAVES):
        angle = np.pi * 2.0**octave * values
        columns += [np.sin(angle), np.cos(angle)]
    encoded: Float64 = np.rint(np.concatenate(columns, axis=1) * (1 << _SINE_BITS))
    return encoded.astype(np.int64)


def _aligned(target: Int64, reference: Integers) -> Int64:
    """Quaternions (N, 4) with the signs that bring them next to those of the reference."""
    # q and -q are the same rotation
    opposite = (target.astype(np.float64) * reference).sum(axis=1, keepdims=True) < 0
    return np.where(opposite, -target, target)


class LatentCoder:
    """Codes P-frames of a sequence with a model."""

    def __init__(self, plan: SequencePlan, model: LatentModel) -> None:
        self._plan, self._model = plan, model

    def code(self, index: int, target: Planes, before: Planes, state: GofState) -> CodedFrame:
        """A frame whose integers `target` are in GoF order, after the frame that left `state`.

        Motion, and refinement of colours, only where the frame comes nearer to its target with it; a frame
        that is as it was `before` is repeated.
        """
        reference = LatentReference(self._model, state, self._plan.header.unit_exponents)
        frame, tools, writer = state.frame, set(), self._writer(index, state)
        has_moved = any((target[a] != before[a]).any() for a in CARRIED)
        if has_moved:
            moved = code_latent_motion(writer, self._goal(target, reference, state), reference)
            if self._leads_nearer(target, moved, state):
                frame = moved
                tools.add(Tool.LATENT)
            else:
                writer = self._writer(index, state)
        refined = self._refined(target, frame, reference, state) if has_moved else frame
        if refined is not frame:
            frame = refined
            tools.add(Tool.REFINEMENT)
        writer.header = InterHeader(b"", frozenset(tools), {})
        after = state.after(frame.on_grid() if tools else frame, InterSymbols(), None)
        return CodedFrame.of(writer, after)

    def _writer(self, index: int, state: GofState) -> FrameWriter:
        writer = self._plan.writer(index)
        code_inter_header(writer, InterHeader(b"", frozenset(), {}), state)
        return writer

    def _features(self, planes: Planes, reference: LatentReference) -> Int64:
        normal = reference.normalisation.of_positions(planes[Attribute.POSITION])
        positions = frequency_encoding(normal / float(1 << NORMAL_BITS))
        rotations = frequency_encoding(planes[Attribute.ROTATION] / float(1 << ROTATION_FRACTION_BITS))
        networks = self._model.networks
        found = [networks["position_features"](positions), networks["rotation_features"](rotations)]
        return np.concatenate(found, axis=1)

    def _latents(self, target: Planes, reference: LatentReference, state: GofState) -> Int64:
        """Latents y (n, 16): g_a of what the Converter makes of the difference of features."""
        rows = reference.rows
        before = {a: state.frame.planes[a].values[rows].astype(np.int64) for a in CARRIED}
        after = {a: target[a][rows] for a in CARRIED}
        after[Attribute.ROTATION] = _aligned(after[Attribute.ROTATION], before[Attribute.ROTATION])
        difference = self._features(after, reference) - self._features(before, reference)
        networks = self._model.networks
        return networks["analysis"](
            networks["converter"](np.clip(difference, -ACTIVATION_LIMIT, ACTIVATION_LIMIT))
        )

    def _goal(self, target: Planes, reference: LatentReference, state: GofState) -> LatentGoal:
        step_log2 = self._plan.options.tuning.latent_step_log2
        header = LatentHeader(len(reference.rows), step_log2, self._spread(reference))
        latents, hyper = self._latents(target, reference, state), None
        if self._model.has_hyperprior:
            expected = self._model.networks["hyper_analysis"](latents)
            hyper = (expected + (1 << (LATENT_BITS - 1))) >> LATENT_BITS
        return LatentGoal(header, latents, hyper)

    def _spread(self, reference: LatentReference) -> SpreadHeader:
        """Motion fades by e over one normalised unit: a network that sees these cannot know others."""
        exponent = self._plan.control.shift - reference.normalisation.exponent
        limited = min(max(exponent, -MAX_DECAY_EXPONENT), MAX_DECAY_EXPONENT)
        return SpreadHeader(self._plan.options.tuning.num_neighbours, limited)

    def _refined(
        self, target: Planes, frame: FrameState, reference: LatentReference, state: GofState
    ) -> FrameState:
        """`frame` refined, where the options or the colours' distance from their target want it."""
        mode = self._plan.options.tuning.refinement
        if mode == RefinementMode.OFF or not self._model.has_refinement:
            return frame
        refined = reference.refined(frame)
        bands = [attribute for attribute in SH_BANDS if attribute in frame.planes]
        if not bands or mode == RefinementMode.ON:
            return refined
        nearer = self._distance(target, refined, state, bands) < self._distance(target, frame, state, bands)
        return refined if nearer else frame

    def _leads_nearer(self, target: Planes, moved: FrameState, state: GofState) -> bool:
        """Whether motion is worth having: it mends clearly more of the image than it spoils.

        Both by what splats differ, which bounds how wrong one can be, and by squared distances in sizes of
        splats, which do not: a few that are flung far away may cover what all others show.
        """
        shown = np.exp2(np.minimum(state.visibility.weights(Attribute.SH_DC) / 16.0, _MAX_WEIGHT))
        before, after = (self._misplacement(target, frame, state) for frame in (state.frame, moved))
        mended = shown * (np.exp(-after / 4) - np.exp(-before / 4))
        gained, lost = mended[mended > 0].sum(), -mended[mended < 0].sum()
        return bool(gained > _LEAST_GAIN * lost and shown @ after < shown @ before)

    def _misplacement(self, target: Planes, frame: FrameState, state: GofState) -> Float64:
        """Squared distance (N,) of each splat from its target, in units of its area.

        Two equal splats d apart differ by 1 - exp(-d**2 / 4 s**2) of their squares, s their deviation. A
        turn counts as what it does to the longest axis.
        """
        units = self._plan.header.unit_exponents
        scales = np.ldexp(state.frame.planes[Attribute.SCALE].wide().astype(np.float64), units.scale)
        axes = np.sort(np.exp(np.clip(scales, -_MAX_LOG_SCALE, _MAX_LOG_SCALE)), axis=1)
        middle, longest = axes[:, 1], axes[:, 2]
        apart = (target[Attribute.POSITION] - frame.planes[Attribute.POSITION].values).astype(np.float64)
        squares: Float64 = (apart**2).sum(axis=1) * 4.0**units.position
        rotations = frame.planes[Attribute.ROTATION].values
        turn = (_aligned(target[Attribute.ROTATION], rotations) - rotations) / float(_HALF_ANGLE)
        squares += (turn**2).sum(axis=1) * (longest**2 - middle**2)
        squares /= middle * longest
        return squares

    def _distance(
        self, target: Planes, frame: FrameState, state: GofState, attributes: list[Attribute]
    ) -> float:
        """Squared distance in quantiser steps, weighted by what the reference says of visibility."""
        total = 0.0
        for attribute in attributes:
            squares = (
                (target[attribute] - frame.planes[attribute].values) / self._plan.steps[attribute]
            ) ** 2
            weights = np.exp2(np.minimum(state.visibility.weights(attribute) / 16.0, _MAX_WEIGHT))
            total += float(weights @ squares.sum(axis=1))
        return total
