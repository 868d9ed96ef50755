"""`dfcgs encode`."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from dfcgs_codec.api import encode_sequence
from dfcgs_codec.bitstream.constants import Profile
from dfcgs_codec.cli import values as parse
from dfcgs_codec.cli.outputs import output_file
from dfcgs_codec.cli.progress import progress_bar
from dfcgs_codec.cli.refusal import note_of_limits
from dfcgs_codec.cli.views import views_beside, views_named, views_note
from dfcgs_codec.encoder.options import EncoderOptions, MotionMode, RefinementMode
from dfcgs_codec.encoder.rate_control import BOUND_UNITS, QUALITIES
from dfcgs_codec.encoder.report import EncodeReport
from dfcgs_codec.errors import InputError, VerificationError
from dfcgs_codec.files import check_file_target
from dfcgs_codec.frames.typed import check_arguments
from dfcgs_codec.ply import InputPolicy, gathered
from dfcgs_codec.sequence import DEFAULT_PATTERN, open_frames
from dfcgs_codec.views.region import DEFAULT_MARGIN

#: for a file of one's own: whatever it needs
_NO_LIMITS = ("--max-memory", "1024T", "--max-gaussians", str(1 << 30))
_EPILOG = """
\b
Examples:
  dfcgs encode frames/ out.dgs
  dfcgs encode frames/*.ply out.dgs
  dfcgs encode frames/ out.dgs --quality high --gof-size 30
  dfcgs encode frames/ out.dgs --bound position=0.001 --bound rotation=0.5
  dfcgs encode scene/ out.dgs --pattern 'frame_*/point_cloud/iteration_7000/point_cloud.ply'
"""


def _options(values: dict[str, Any]) -> EncoderOptions:
    return EncoderOptions(
        quality=values["quality"] if values["psnr"] is None else values["psnr"],
        qp=values["qp"],
        bounds=values["bound"],
        gof_size=values["gof_size"],
        motion=values["motion"],
        control_spacing=values["control_spacing"],
        num_neighbours=values["control_neighbours"],
        profile=values["profile"],
        latent_step=values["latent_step"],
        refinement=values["refinement"],
        visibility=values["steps"] == "visibility",
        balance=values["balance"] == "auto",
        exact=values["exact"] == "auto",
        views=views_named(values["views"]),
        views_margin=values["views_margin"],
        keep_unseen=values["keep_unseen"],
        intra=values["intra"],
        order=values["order"],
        frame_rate=values["fps"],
        keep_axes=values["keep_axes"],
        jobs=values["jobs"],
    )


def _with_views(options: EncoderOptions, paths: list[Path]) -> tuple[EncoderOptions, list[str]]:
    """The options with the cameras that lie beside the frames, and what is to be said of them."""
    views, notes = views_beside(paths)
    return replace(options, views=views), notes


def _verify(target: Path) -> None:
    """Decode in a fresh process that has the file alone; every frame's hash is the encoder's."""
    command = [sys.executable, "-m", "dfcgs_codec", "decode", str(target), "--check-only", "--quiet"]
    command += _NO_LIMITS
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except KeyboardInterrupt:
        raise InputError(f"interrupted; {target} is written, but was not verified") from None
    if done.returncode:
        raise VerificationError(f"{target} does not decode to what was encoded: {done.stderr.strip()}")


def _errors(report: EncodeReport) -> dict[str, dict[str, Any]]:
    return {
        name: {"max": error.maximum, "mean": error.mean, "unit": BOUND_UNITS[name]}
        for name, error in report.errors.items()
        if error.count
    }


def _summary(report: EncodeReport, target: Path) -> str:
    count = len(report.frames)
    kinds = [frame.kind for frame in report.frames]
    lines = [
        f"{target}: {count} frames ({kinds.count('I')} I, {kinds.count('P')} P, "
        f"{kinds.count('skip')} skipped), "
        f"{report.num_bytes} bytes, {report.num_bytes / count:.0f} per frame",
    ]
    if report.estimated_psnr is not None:
        lines.append(f"images: about {report.estimated_psnr:.1f} dB (estimated), at QP {report.qp:.1f}")
    if report.num_unseen:
        lines.append(f"left out: {report.num_unseen} Gaussians of the first frame, which no viewer sees")
        if report.unseen_cost_db is not None:
            lines[-1] += f" (costs about {report.unseen_cost_db:.2f} dB)"
    lines.append(f"{'error':10} {'max':>12} {'mean':>12}")
    for name, error in _errors(report).items():
        lines.append(f"{name:10} {error['max']:12.6g} {error['mean']:12.6g}  {error['unit']}")
    return "\n".join(lines)


@click.command(epilog=_EPILOG)
@click.argument("frames", nargs=-1, metavar="FRAMES...")
@click.argument("output", type=click.Path(), callback=output_file)
@click.option(
    "--quality",
    type=click.Choice(list(QUALITIES)),
    default="medium",
    show_default=True,
    help="Quality of images: " + ", ".join(f"{name} {psnr:g} dB" for name, psnr in QUALITIES.items()) + ".",
)
@click.option(
    "--psnr", type=float, metavar="DB", help="The same as a number: PSNR of images. Overrides --quality."
)
@click.option(
    "--qp",
    type=float,
    help="Quantiser, 0 (finest) to 51; the step doubles every 6, whatever the quality. Overrides --psnr.",
)
@click.option(
    "--bound",
    type=parse.bound,
    metavar="ATTRIBUTE=VALUE",
    multiple=True,
    help=f"Guarantee a maximum error; {', '.join(BOUND_UNITS)}. Repeatable.",
)
@click.option(
    "--gof-size",
    type=parse.gof_size,
    metavar="[auto|FRAMES]",
    default="auto",
    show_default=True,
    help="Frames from one I-frame to the next, at most; auto: the encoder chooses, 60 at most, "
    "or 10 in profile paper.",
)
@click.option(
    "--motion",
    type=click.Choice([mode.value for mode in MotionMode]),
    default="auto",
    show_default=True,
    help="Where control points carry the Gaussians along: auto where that pays; only: and no residual.",
)
@click.option(
    "--control-spacing", type=int, default=70, show_default=True, help="Gaussians to a control point."
)
@click.option(
    "--control-neighbours",
    type=int,
    default=30,
    show_default=True,
    help="Gaussians that a control point moves, with --profile paper.",
)
@click.option(
    "--profile",
    type=click.Choice([profile.name.lower() for profile in Profile]),
    default="main",
    show_default=True,
    help="paper: motion by the network of D-FCGS as published, GoFs of 10; for comparison.",
)
@click.option(
    "--latent-step",
    type=float,
    default=1.0,
    show_default=True,
    help="q' of the paper, a power of two; with --profile paper.",
)
@click.option(
    "--refinement",
    type=click.Choice([mode.value for mode in RefinementMode]),
    default="auto",
    show_default=True,
    help="Colour refinement, with --profile paper: where it brings colours nearer, or in every frame.",
)
@click.option(
    "--steps",
    type=click.Choice(["visibility", "uniform"]),
    default="visibility",
    show_default=True,
    help="Quantiser steps: coarser for Gaussians that show less, or one for all.",
)
@click.option(
    "--balance",
    type=click.Choice(["auto", "off"]),
    default="auto",
    show_default=True,
    help="Whether steps of attributes follow how much each shows in the first frame.",
)
@click.option(
    "--exact",
    type=click.Choice(["auto", "off"]),
    default="auto",
    show_default=True,
    help="Whether values that another tool has quantised are kept as they are, where that is smaller.",
)
@click.option(
    "--views",
    metavar="FILE|none",
    show_default="found beside the frames",
    help="The cameras between which viewers stand: cameras.json, transforms.json or a folder of COLMAP.",
)
@click.option(
    "--views-margin",
    type=float,
    metavar="SHARE",
    default=DEFAULT_MARGIN,
    show_default=True,
    help="How far outside the cameras viewers stand, as a share of the distance between them.",
)
@click.option("--keep-unseen", is_flag=True, help="Keep what is seen from none of the views as the rest.")
@click.option(
    "--intra",
    type=click.Choice(["coded", "ply"]),
    default="coded",
    show_default=True,
    help="I-frames quantised, or float32 verbatim.",
)
@click.option(
    "--order",
    type=click.Choice(["sequence", "input", "free"]),
    default="sequence",
    show_default=True,
    help="Order of decoded Gaussians: one for the sequence, the input's, or any.",
)
@click.option(
    "--fps",
    type=parse.frame_rate,
    metavar="RATE",
    default="30",
    show_default=True,
    help="Frame rate to write into the file.",
)
@click.option("--keep-axes", is_flag=True, help="Keep the order and signs of each Gaussian's axes.")
@click.option(
    "--pattern",
    default=DEFAULT_PATTERN,
    show_default=True,
    help="Which files of the folder are frames; may contain folders. By default PLYs in any case and, where "
    "the folder has none, those of trainers' trees.",
)
@click.option(
    "--order-by",
    default="number",
    show_default=True,
    metavar="number|name|PATTERN",
    help="What orders the frames: the number in their names that differs in all; their names; or a part of "
    "the names with {} in place of the number that counts, such as 'frame_{}' (* is any text).",
)
@click.option("--allow-gaps", is_flag=True, help="Accept missing frame numbers.")
@click.option(
    "--drop-extra", is_flag=True, help="Leave out PLY properties and elements that the codec does not keep."
)
@click.option(
    "--repair", is_flag=True, help="Put what viewers show in place of NaN, infinities and zero quaternions."
)
@click.option(
    "--bake-filter", is_flag=True, help="Put the filter_3D of mip-splatting into scale and opacity."
)
@click.option("--jobs", type=int, default=None, show_default="all cores", help="Processes.")
@click.option("--verify", is_flag=True, help="Decode the file in a fresh process and compare.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
def encode(frames: tuple[str, ...], output: Path, **values: Any) -> None:
    """Encode FRAMES, a folder of PLYs, the files themselves or a params.npz, into the file OUTPUT (.dgs)."""
    if not frames:
        raise click.UsageError(f"two arguments are needed: dfcgs encode {output} out.dgs")
    check_arguments(frames, str(output))
    policy = InputPolicy(
        drop_extra=values["drop_extra"],
        repair=values["repair"],
        bake_filter=values["bake_filter"],
        keep_bits=values["intra"] == "ply",
    )
    options = _options(values)
    check_file_target(output, force=values["force"])
    source = open_frames(
        frames,
        values["pattern"],
        allow_gaps=values["allow_gaps"],
        order_by=values["order_by"],
        policy=policy,
    )
    told = list(source.notes)
    if values["views"] is None and options.profile == Profile.MAIN:
        options, notes = _with_views(options, source.paths)
        told += notes
    told += views_note(options.views)
    # said before the work begins: whoever meant other files need not wait for its end
    for note in told:
        click.echo(f"note: {note}", err=True)
    with progress_bar("encoding", values["quiet"]) as progress:
        report = encode_sequence(source, output, options, force=values["force"], progress=progress)
    notes = gathered(report.notes[len(source.notes) :])
    for note in notes:
        click.echo(f"note: {note}", err=True)
    note_of_limits(output)
    if values["verify"]:
        _verify(output)
    if values["as_json"]:
        records = [vars(frame) for frame in report.frames]
        said = ("num_bytes", "qp", "estimated_psnr", "num_unseen", "unseen_cost_db")
        result: dict[str, Any] = {name: getattr(report, name) for name in said}
        result |= {"errors": _errors(report), "notes": [*told, *notes], "verified": values["verify"]}
        click.echo(json.dumps(result | {"frames": records}))
    elif not values["quiet"]:
        click.echo(_summary(report, output) + ("\nverified" if values["verify"] else ""))
