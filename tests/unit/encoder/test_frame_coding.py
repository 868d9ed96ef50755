"""What an encoder keeps as its reference is what a decoder reads from the frame's chunks."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest

from dfcgs_codec.bitstream.constants import IntraKind, OutputOrder
from dfcgs_codec.bitstream.container import ContainerWriter
from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.encoder.frame import segment as segment_module
from dfcgs_codec.encoder.frame.frame_coding import CodedFrame
from dfcgs_codec.encoder.frame.segment import SegmentEncoder
from dfcgs_codec.encoder.plan.planning import plan_sequence
from dfcgs_codec.encoder.residual import inter_coding
from dfcgs_codec.sequence import MemorySource
from lab.options import encoder_options
from lab.small_clouds import all_changing, drifting, make_cloud


def coded_frames(monkeypatch: pytest.MonkeyPatch) -> list[CodedFrame]:
    """Collects every frame that the encoder codes from now on, tried ones too."""
    found: list[CodedFrame] = []
    for module, name in (
        (segment_module, "coded_intra"),
        (segment_module, "coded_verbatim"),
        (inter_coding, "coded_inter"),
    ):
        original = getattr(module, name)

        def spy(*arguments: object, original=original) -> CodedFrame:
            found.append(original(*arguments))
            return found[-1]

        monkeypatch.setattr(module, name, spy)
    return found


@pytest.mark.parametrize("intra", IntraKind)
@pytest.mark.parametrize("order", OutputOrder)
def test_states_are_equal_plane_by_plane(
    intra: IntraKind, order: OutputOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = all_changing(make_cloud(40, 1), 3) + drifting(make_cloud(30, 1), 2)
    source = MemorySource(frames)
    plan = plan_sequence(source, encoder_options(intra=intra, order=order, gof_size=9))
    tried = coded_frames(monkeypatch)
    segment = SegmentEncoder(source, plan).encode(0, len(frames))
    file = BytesIO()
    writer = ContainerWriter(file, plan.header)
    for gof in segment.gofs:
        writer.gof(gof.first_frame, gof.frames)
    writer.finish()
    by_data = {coded.data: coded for coded in tried}
    chunks = [data for gof in segment.gofs for data in gof.frames]
    for data, decoded in zip(chunks, SequenceDecoder(file).frames(), strict=True):
        kept = by_data[data].state.frame
        assert kept.hash() == decoded.state.hash()
        assert list(kept.planes) == list(decoded.state.planes)
        for attribute, plane in kept.planes.items():
            assert np.array_equal(plane.values, decoded.state.planes[attribute].values)
        assert (kept.order is None) == (decoded.state.order is None)
        assert (kept.verbatim is None) == (decoded.state.verbatim is None)
