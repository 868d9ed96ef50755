"""Annex B: the decoding process of profile PAPER."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tests.spec_decoder.basics import ESCAPE, LATENT, REFINEMENT, require
from tests.spec_decoder.latents import Normalisation, Priors, latent_motions, motion_of_output, refined
from tests.spec_decoder.spreading import Spreading
from tests.spec_decoder.state import State

if TYPE_CHECKING:
    from tests.spec_decoder.basics import Fields
    from tests.spec_decoder.gof import Gof
    from tests.spec_decoder.headers import Sequence
    from tests.spec_decoder.latents import FrozenModel


class PaperGof:
    """What is kept for a GoF beside its state."""

    def __init__(self, gof: Gof, model: FrozenModel, sequence: Sequence) -> None:
        self._gof, self._model, self._sequence = gof, model, sequence
        self._intra = gof.state.positions
        self._normalisation = Normalisation(self._intra)
        self._spreading: Spreading | None = None

    def frame(self, fields: Fields, following: Callable[[int], Fields]) -> tuple[bytes, bool]:
        """B.1: the hash of a P-frame, and whether escapes follow; `following` is the next chunk of a type."""
        gof, model = self._gof, self._model
        frame_hash, tools, mask = fields.raw(16), fields.u8(), fields.u8()
        require(tools & ~(LATENT | REFINEMENT | ESCAPE) == 0 and mask == 0)
        require(fields.place == len(fields.data))
        require("refinement" in model.networks or not tools & REFINEMENT)
        if tools:
            # A.2: no float32 values
            gof.state = reference = State(gof.state.planes, gof.state.order)
            prior = Priors(model, reference.planes, self._normalisation, self._sequence)
            if tools & LATENT:
                gof.state = self._moved(reference, prior, following)
            if tools & REFINEMENT:
                changes = [model.network("refinement", prior.of(i)) for i in range(len(reference.positions))]
                gof.state = State(refined(gof.state.planes, changes, self._sequence), gof.state.order)
        return frame_hash, bool(tools & ESCAPE)

    def _moved(self, reference: State, prior: Priors, following: Callable[[int], Fields]) -> State:
        """B.5 to B.7."""
        if self._spreading is None:
            self._spreading = Spreading(self._intra, self._gof.control)
        hyper = following(0x21) if "hyper_synthesis" in self._model.networks else None
        motions, spread = latent_motions(
            self._model, self._spreading.gaussian, prior, (hyper, following(0x22))
        )
        in_units = [motion_of_output(m, self._normalisation.size) for m in motions]
        return self._spreading.moved(reference, in_units, spread)
