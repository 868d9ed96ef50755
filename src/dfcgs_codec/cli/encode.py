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
from dfcgs_codec.cli.encode_options import GROUPS, GroupedCommand
from dfcgs_codec.cli.progress import progress_bar
from dfcgs_codec.cli.refusal import note_of_limits
from dfcgs_codec.cli.values import output_file
from dfcgs_codec.cli.views import views_beside, views_named, views_note
from dfcgs_codec.encoder.frame.report import EncodeReport
from dfcgs_codec.encoder.plan.options import EncoderOptions
from dfcgs_codec.encoder.plan.quantiser_steps import BOUND_UNITS
from dfcgs_codec.errors import InputError, VerificationError
from dfcgs_codec.files import check_file_target
from dfcgs_codec.frames.typed import check_arguments
from dfcgs_codec.ply import InputPolicy, gathered
from dfcgs_codec.sequence import open_frames

#: for a file of one's own: whatever it needs
_NO_LIMITS = ("--max-memory", "1024T", "--max-gaussians", str(1 << 30))
_EPILOG = """
\b
Examples:
  dfcgs encode frames/ out.dgs
  dfcgs encode frames/*.ply out.dgs
  dfcgs encode frames/ out.dgs --quality high --gof-size 30
  dfcgs encode frames/ out.dgs --quality lossless
  dfcgs encode frames/ out.dgs --bound position=0.001 --bound rotation=0.5
  dfcgs encode scene/ out.dgs --pattern 'frame_*/point_cloud/iteration_7000/point_cloud.ply'
"""


def _options(values: dict[str, Any]) -> EncoderOptions:
    return EncoderOptions(
        quality=values["quality"] if values["psnr"] is None else values["psnr"],
        qp=values["qp"],
        bounds=values["bound"],
        views=views_named(values["views"]),
        views_margin=values["views_margin"],
        keep_unseen=values["keep_unseen"],
        gof_size=values["gof_size"],
        frame_rate=values["fps"],
        order=values["order"],
        profile=values["profile"],
        jobs=values["jobs"],
    )


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


@click.command(cls=GroupedCommand, groups=GROUPS, epilog=_EPILOG)
@click.argument("frames", nargs=-1, metavar="FRAMES...")
@click.argument("output", type=click.Path(), callback=output_file)
def encode(frames: tuple[str, ...], output: Path, **values: Any) -> None:
    """Encode FRAMES, a folder of PLYs, the files themselves or a params.npz, into the file OUTPUT (.dgs)."""
    if not frames:
        raise click.UsageError(f"two arguments are needed: dfcgs encode {output} out.dgs")
    check_arguments(frames, str(output))
    options = _options(values)
    policy = InputPolicy(
        drop_extra=values["drop_extra"],
        repair=values["repair"],
        bake_filter=values["bake_filter"],
        keep_bits=options.is_lossless,
    )
    check_file_target(output, force=values["force"])
    source = open_frames(
        frames,
        values["pattern"],
        allow_gaps=values["allow_gaps"],
        order_by=values["order_by"],
        policy=policy,
    )
    told = list(source.notes)
    if values["views"] is None and options.profile == Profile.MAIN and not options.is_lossless:
        views, notes = views_beside(source.paths)
        options, told = replace(options, views=views), [*told, *notes]
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
