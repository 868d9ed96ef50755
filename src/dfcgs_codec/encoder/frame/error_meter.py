"""The errors of each frame as a decoder will have it; what did not change is not measured again."""

from __future__ import annotations

from dataclasses import replace

from dfcgs_codec.bitstream.constants import Attribute
from dfcgs_codec.bitstream.sequence_header import UnitExponents
from dfcgs_codec.codec.state.planes import SH_BANDS, FrameState, Plane, output
from dfcgs_codec.encoder.frame.report import ERROR_FIELDS, ErrorStatistics, errors_of
from dfcgs_codec.encoder.frame.targets import Planes
from dfcgs_codec.encoder.matching.identity import Members
from dfcgs_codec.gaussians import GaussianCloud

_ATTRIBUTES = {
    "position": (Attribute.POSITION,),
    "rotation": (Attribute.ROTATION,),
    "scale": (Attribute.SCALE,),
    "alpha": (Attribute.OPACITY,),
    "colour": (Attribute.SH_DC,),
    "sh": SH_BANDS,
}
#: planes that were aimed at, planes that were decoded, float values that stand for these
_Known = tuple[list[object], list[Plane], GaussianCloud | None]


class ErrorMeter:
    """Compares decoded frames with the input."""

    def __init__(self, units: UnitExponents) -> None:
        self._units = units
        self._known: dict[str, tuple[_Known, ErrorStatistics]] = {}

    def measure(
        self, cloud: GaussianCloud, members: Members, target: Planes, state: FrameState
    ) -> dict[str, ErrorStatistics]:
        """Errors of `state` against the input frame `cloud`, whose planes in GoF order are `target`.

        Planes that are the same objects as in the frame before have its errors.
        """
        decoded = output(replace(state, order=None), self._units)
        found = {}
        for name, attributes in _ATTRIBUTES.items():
            present = [attribute for attribute in attributes if attribute in target]
            key: _Known = ([target[a] for a in present], [state.planes[a] for a in present], state.verbatim)
            known = self._known.get(name)
            if known is None or not _same(known[0], key):
                field = ERROR_FIELDS[name]
                statistics = ErrorStatistics()
                statistics.add(errors_of(name, members.values(cloud, field), getattr(decoded, field)))
                self._known[name] = (key, statistics)
            found[name] = self._known[name][1]
        return found


def _same(before: _Known, now: _Known) -> bool:
    old, new = [*before[0], *before[1]], [*now[0], *now[1]]
    if before[2] is not now[2]:
        return False
    return len(old) == len(new) > 0 and all(a is b for a, b in zip(old, new, strict=True))
