"""The options of `dfcgs encode`, by group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

from dfcgs_codec.bitstream.constants import OutputOrder, Profile
from dfcgs_codec.cli import values as parse
from dfcgs_codec.encoder.plan.quantiser_steps import BOUND_UNITS, QUALITIES
from dfcgs_codec.sequence import DEFAULT_PATTERN
from dfcgs_codec.views.region import DEFAULT_MARGIN

#: the group that only `--help-all` shows
MORE = "More options"


def _show_all(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        ctx.meta[MORE] = True
        click.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()


class GroupedCommand(click.Command):
    """A command with options by the name of their group; `MORE` is one of the groups."""

    def __init__(self, *args: Any, groups: Mapping[str, Sequence[click.Option]], **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.groups = groups
        self.params += [option for options in groups.values() for option in options]
        self.params.append(
            click.Option(
                ["--help-all"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=_show_all,
                help="Show this message with more options, which few need.",
            )
        )

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A section for each group, then how to get help."""
        shown = {name: options for name, options in self.groups.items() if name != MORE or MORE in ctx.meta}
        grouped = {id(option) for options in self.groups.values() for option in options}
        options = [parameter for parameter in self.get_params(ctx) if isinstance(parameter, click.Option)]
        rest = [option for option in options if id(option) not in grouped]
        for name, parameters in {**shown, "Help": rest}.items():
            records = [parameter.get_help_record(ctx) for parameter in parameters]
            with formatter.section(name):
                formatter.write_dl([record for record in records if record is not None])


_NAMES = ", ".join(f"{name} ({psnr:g})" for name, psnr in QUALITIES.items())

_QUALITY = [
    click.Option(
        ["--quality"],
        type=parse.quality,
        metavar="NAME|DB|lossless",
        default="medium",
        show_default=True,
        help=f"PSNR of images, which the encoder estimates: 15 to 70 dB, or a name: {_NAMES}. lossless: all "
        "frames are I-frames of the input's float32 values.",
    ),
    click.Option(
        ["--qp"],
        type=float,
        help="The quantiser in place of a quality, 0 (finest) to 51; steps double every 6.",
    ),
    click.Option(
        ["--bound"],
        type=parse.bound,
        metavar="ATTRIBUTE=VALUE",
        multiple=True,
        help=f"Guarantee a largest error of {', '.join(BOUND_UNITS)}. Repeatable.",
    ),
    click.Option(
        ["--views"],
        metavar="FILE|none",
        show_default="found beside the frames",
        help="The cameras between which viewers stand: cameras.json, transforms.json or a folder of COLMAP. "
        "What is seen from nowhere between them is left out.",
    ),
]

_TIME = [
    click.Option(
        ["--gof-size"],
        type=parse.gof_size,
        metavar="auto|FRAMES",
        default="auto",
        show_default=True,
        help="Frames from one I-frame to the next, at most: fewer make seeking quicker and the file larger. "
        "auto: 60 at most.",
    ),
    click.Option(
        ["--fps"],
        type=parse.frame_rate,
        metavar="RATE",
        default="30",
        show_default=True,
        help="Frame rate to write into the file: 30, 29.97 or 30000/1001.",
    ),
]

_INPUT = [
    click.Option(
        ["--pattern"],
        default=DEFAULT_PATTERN,
        show_default=True,
        help="Which files of the folder are frames; may contain folders. By default PLYs in any case and, "
        "where the folder has none, those of trainers' trees.",
    ),
    click.Option(
        ["--order-by"],
        default="number",
        show_default=True,
        metavar="number|name|PATTERN",
        help="What orders the frames: the number in their names that differs in all; their names; or a part "
        "of the names with {} in place of the number that counts, such as 'frame_{}' (* is any text).",
    ),
    click.Option(["--allow-gaps"], is_flag=True, help="Accept missing frame numbers."),
    click.Option(
        ["--drop-extra"],
        is_flag=True,
        help="Leave out PLY properties and elements that the codec does not keep.",
    ),
    click.Option(
        ["--repair"],
        is_flag=True,
        help="Put what viewers show in place of NaN, infinities and zero quaternions.",
    ),
]

_OUTPUT = [
    click.Option(["--jobs"], type=int, default=None, show_default="all cores", help="Processes."),
    click.Option(["--verify"], is_flag=True, help="Decode the file in a fresh process and compare."),
    click.Option(["--force"], is_flag=True, help="Replace an existing file."),
    click.Option(["--json", "as_json"], is_flag=True, help="Print the report as JSON."),
    click.Option(["--quiet", "-q"], is_flag=True, help="Print nothing but errors."),
]

_MORE = [
    click.Option(["--psnr"], type=float, metavar="DB", help="The same as --quality DB, which it overrides."),
    click.Option(
        ["--views-margin"],
        type=float,
        metavar="SHARE",
        default=DEFAULT_MARGIN,
        show_default=True,
        help="How far outside the cameras viewers stand, as a share of the distance between them.",
    ),
    click.Option(
        ["--keep-unseen"],
        is_flag=True,
        help="Keep what is seen from nowhere between the cameras, in coarser steps.",
    ),
    click.Option(
        ["--bake-filter"], is_flag=True, help="Put the filter_3D of mip-splatting into scale and opacity."
    ),
    click.Option(
        ["--order"],
        type=click.Choice([order.name.lower() for order in OutputOrder]),
        default="sequence",
        show_default=True,
        help="Order of decoded Gaussians: one for the sequence, the input's, or any.",
    ),
    click.Option(
        ["--profile"],
        type=click.Choice([profile.name.lower() for profile in Profile]),
        default="main",
        show_default=True,
        help="paper: P-frames as D-FCGS was published, at most 10 frames from one I-frame to the next; for "
        "comparison.",
    ),
]

GROUPS = {"Quality": _QUALITY, "Time": _TIME, "Input": _INPUT, "Output": _OUTPUT, MORE: _MORE}
