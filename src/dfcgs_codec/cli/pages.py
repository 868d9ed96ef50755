"""What `view` and `export` have in common: how the scene is looked at first."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from dfcgs_codec.codec.frame.decoder import SequenceDecoder
from dfcgs_codec.player.page import UP_AXES, StartView
from dfcgs_codec.views.read import read_views

UP = click.option(
    "--up",
    type=click.Choice(UP_AXES),
    default=UP_AXES[0],
    show_default=True,
    help="The axis that points upwards: -y in captures, +y or +z in most made scenes.",
)
VIEWS = click.option(
    "--views",
    metavar="FILE",
    help="Begin where the first camera of this file stands: cameras.json, transforms.json or a folder of "
    "COLMAP.",
)


def start_view(views: str | None, file: Path) -> StartView | None:
    """The view of the first camera that was named; it turns around what the middle Gaussian before it is."""
    if views is None:
        return None
    camera = read_views(views).cameras[0]
    with file.open("rb") as stream:
        positions = next(iter(SequenceDecoder(stream).frames(0, 1))).cloud().positions
    depths = (positions - camera.position) @ camera.forward
    before = depths[depths > 0]
    return StartView.of(camera, float(np.median(before)) if len(before) else 1.0)
