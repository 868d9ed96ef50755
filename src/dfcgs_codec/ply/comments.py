"""Which comment lines of a PLY change how a viewer shows the frame.

Known spellings: `SplatRenderMode: mip` (Brush, gsplat, nerfstudio, splat-transform), `antialiased 1`
(Postshot), `train_flags antialiasing`, `Vertical axis: y` (Brush), `Vertical Axis: z` (nerfstudio), and what
tools write about axes, colour spaces and filters in words of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

MAX_COMMENTS = 16
MAX_COMMENT_BYTES = 255

_DISPLAY = re.compile(
    rb"""(?ix)
      splat [ _-]? render [ _-]? mode | render(er)? [ _-]? mode | raster(iz|is)(e|er|ation) [ _-]? mode
    | anti [ _-]? alias | \bmip\b | mip [ _-]? splat
    | kernel [ _-]? size | (2d|3d|low [ _-]? pass) [ _-]? filter
    | \b [23]dgs \b
    | (vertical|up|forward) [ _-]? (axis|vector|direction) | \b [xyz] [ _-]? (up|down) \b | \b up \s* [:=]
    | coordinate [ _-]? (system|frame|space) | handed(ness)? \b | \b (rdf|rub|luf|ruf) \b
    | colou?r [ _-]? (space|profile|primaries) | \b srgb \b | \b linear [ _-]? (rgb|colou?r) | \b gamma \b
    """
)


def display_comments(comments: Iterable[bytes]) -> tuple[bytes, ...]:
    """The comments worth keeping, in their order; of many the last ones, for viewers heed the last."""
    kept = [c for c in comments if len(c) <= MAX_COMMENT_BYTES and _DISPLAY.search(c)]
    return tuple(kept[-MAX_COMMENTS:])
