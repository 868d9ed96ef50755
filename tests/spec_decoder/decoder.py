"""Chapter 2: the decoding process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import (
    ESCAPE,
    MOTION,
    PAPER,
    STATE_LIMIT,
    TOPOLOGY,
    VISIBILITY,
    require,
)
from tests.spec_decoder.headers import check_escapes, chunks, intra_frame, sequence_header, topology_chunk
from tests.spec_decoder.inter import residual
from tests.spec_decoder.latents import FrozenModel
from tests.spec_decoder.models import find_model
from tests.spec_decoder.output import Frame
from tests.spec_decoder.paper import PaperGof
from tests.spec_decoder.prior import PriorModel
from tests.spec_decoder.state import State
from tests.spec_decoder.steps import Steps, reconstruct_inter

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields
    from tests.spec_decoder.gof import Gof
    from tests.spec_decoder.inter import Activity
    from tests.spec_decoder.models import Models


class Decoder:
    """Frames of a file, from its beginning; `models` by id."""

    def __init__(self, data: bytes, models: Models | None = None) -> None:
        self._chunks = chunks(data)
        kind, _, fields = next(self._chunks)
        require(kind == 0x01)
        self.sequence = sequence_header(fields)
        self._model: FrozenModel | None = None
        self._prior: PriorModel | None = None
        if self.sequence.profile == PAPER:
            networks: tuple[str, ...] = ("fusion", "synthesis")
            self._model = FrozenModel(find_model(self.sequence, models or {}, networks))
        else:
            networks = ("flags", "columns", "control")
            self._prior = PriorModel(find_model(self.sequence, models or {}, networks))

    def frames(self) -> Iterator[Frame]:
        expected = 0
        gof: Gof | None = None
        paper: PaperGof | None = None
        empty = State({a: [] for a in self.sequence.attributes})
        for kind, frame_index, fields in self._chunks:
            if kind in (0x7E, 0x7F):
                continue
            require(frame_index == expected)
            if kind == 0x10:
                frame_hash, gof, has_escapes = intra_frame(fields, self.sequence)
                if gof is not None:
                    gof.prior = self._prior
                    if self._model is not None:
                        paper = PaperGof(gof, self._model, self.sequence)
                    if has_escapes:
                        self._escape(frame_index, gof)
            else:
                require(kind == 0x20 and expected > 0)
                if gof is None:
                    frame_hash = fields.raw(16)
                    require(fields.raw(2) == bytes(2) and fields.place == len(fields.data))
                elif paper is None:
                    frame_hash = self._inter_frame(fields, frame_index, gof)
                else:
                    frame_hash, has_escapes = paper.frame(
                        fields, lambda kind, index=frame_index: self._following(kind, index)
                    )
                    if has_escapes:
                        self._escape(frame_index, gof)
            yield Frame(frame_index, frame_hash, empty if gof is None else gof.state, self.sequence)
            expected += 1
        require(expected == self.sequence.num_frames)

    def _following(self, kind: int, frame_index: int) -> Fields:
        """The payload of a chunk that belongs to the INTER_FRAME chunk before it (3.2)."""
        found, index, fields = next(self._chunks)
        require(found == kind and index == frame_index)
        return fields

    def _escape(self, frame_index: int, gof: Gof) -> None:
        """6.5."""
        fields = self._following(0x25, frame_index)
        escapes = check_escapes(fields, self.sequence, len(gof.state.positions))
        gof.state = State(gof.state.planes, gof.state.order, None, escapes)

    def _inter_frame(self, fields: Fields, frame_index: int, gof: Gof) -> bytes:
        frame_hash, tools, mask = fields.raw(16), fields.u8(), fields.u8()
        attributes = [a for a in self.sequence.attributes if mask >> a & 1]
        require(
            tools & ~(MOTION | TOPOLOGY | VISIBILITY | ESCAPE) == 0
            and mask < 1 << len(self.sequence.attributes)
        )
        require(mask > 0 or not tools & VISIBILITY)
        steps = {attribute: fields.uvarint() for attribute in attributes}
        levels = {attribute: fields.svarint() for attribute in attributes if tools & VISIBILITY}
        require(all(abs(level) <= STATE_LIMIT for level in levels.values()))
        require(fields.place == len(fields.data))
        if tools or mask:
            # 9.3: no float32 values with any tool, VISIBILITY alone included, and no escapes but its own
            gof.state = State(gof.state.planes, gof.state.order)
        topology, motion = None, None
        if tools & TOPOLOGY:
            n = len(gof.state.positions)
            topology = topology_chunk(self._following(0x23, frame_index), self.sequence, n)
            gof.keep(topology.kept)
        reference = gof.state.positions
        if tools & MOTION:
            motion = gof.motion.decode(self._following(0x22, frame_index))
            gof.state = gof.motion.carry(gof.state, motion.follows)
        activity: dict[int, Activity] = {}
        frame_steps = Steps(steps, levels, self.sequence.exponents, gof.cover)
        if mask:
            fields = self._following(0x24, frame_index)
            activity = residual(fields, gof, frame_steps, motion)
        gof.history = activity
        gof.state = reconstruct_inter(activity, frame_steps, gof.state)
        if motion:
            gof.motion.learn(reference, gof.state.positions)
        if topology:
            gof.settle(topology)
        if tools & ESCAPE:
            self._escape(frame_index, gof)
        return frame_hash
