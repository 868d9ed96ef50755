"""The command line: a thin skin over the library. Data goes to stdout, talk to stderr.

Exit codes: 0 done, 1 failed, 2 usage, 3 bitstream refused.
"""

from __future__ import annotations

import difflib
import os
import sys
from importlib import import_module

import click

from dfcgs_codec._version import __version__
from dfcgs_codec.cli.ends import ended_by_signals, message
from dfcgs_codec.errors import BitstreamError, DfcgsError
from dfcgs_codec.spelling import command_line

EXIT_FAILED, EXIT_REFUSED = 1, 3
_BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
#: name, and what `dfcgs --help` says; modules are loaded when their command is
_COMMANDS = {
    "encode": "Encode a folder of PLY frames into one .dgs file.",
    "decode": "Decode a .dgs file into a folder of PLY frames.",
    "info": "Say what is in a .dgs file and where its bytes go.",
    "view": "Show a .dgs file, or two side by side, in the browser.",
    "export": "Make a web page that plays a .dgs file.",
}


class _LazyGroup(click.Group):
    """Loads a command's module only when it runs, so that --help is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args:
            raise click.UsageError(f"name a command: {', '.join(_COMMANDS)}", ctx)
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name not in _COMMANDS and not name.startswith("-"):
            near = difflib.get_close_matches(name, _COMMANDS, 1)
            other = f"did you mean {near[0]}?" if near else f"there are {', '.join(_COMMANDS)}"
            raise click.UsageError(f"no command {name!r}; {other}", ctx)
        return super().resolve_command(ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"dfcgs_codec.cli.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="dfcgs")
def cli() -> None:
    """Codec for sequences of 3D Gaussian Splatting frames (free-viewpoint video).

    \b
    Examples:
      dfcgs encode frames/ out.dgs
      dfcgs decode out.dgs decoded/
      dfcgs info out.dgs
      dfcgs view out.dgs

    Exit codes: 0 done, 1 failed, 2 usage, 3 bitstream refused.
    """


def _one_blas_thread() -> None:
    """Keep numpy's BLAS to one thread, unless the user asks for more; numpy must not be loaded yet.

    The encoder's matrix products are too thin for two: on idle cores a second thread gains nothing, on
    shared ones its busy waiting slows the whole encoding down several times.
    """
    for name in _BLAS_VARIABLES:
        os.environ.setdefault(name, "1")


def main() -> None:
    """Run the command line; errors become one line on stderr and an exit code."""
    _one_blas_thread()
    with ended_by_signals(), command_line():
        _run()


def _run() -> None:
    try:
        cli.main(prog_name="dfcgs", standalone_mode=False)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        _fail(_usage(error), error.exit_code)
    except (click.Abort, KeyboardInterrupt) as error:
        _fail(message(error), EXIT_FAILED)
    except BitstreamError as error:
        _fail(f"{error} [{error.code}]", EXIT_REFUSED)
    except DfcgsError as error:
        _fail(f"{error} [{error.code}]", EXIT_FAILED)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(EXIT_FAILED)
    except OSError as error:
        _fail(_system_error(error), EXIT_FAILED)
    except MemoryError:
        _fail("out of memory; encode with fewer --jobs, or where more is free", EXIT_FAILED)
    except RuntimeError as error:
        # an interrupt inside a lock of the threading module comes out as this
        if isinstance(error.__context__, KeyboardInterrupt):
            _fail(message(error), EXIT_FAILED)
        if "can't start new thread" not in str(error):
            raise
        _fail(
            "the system lets this user start no more threads (ulimit -u); encode with --jobs 1, or end other "
            "programs",
            EXIT_FAILED,
        )


def _system_error(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    return f"{error.filename}: {reason}" if error.filename else reason


def _usage(error: click.ClickException) -> str:
    """What is wrong with the arguments, and how the command is used, in one line."""
    text = " ".join(error.format_message().split())
    context = error.ctx if isinstance(error, click.UsageError) else None
    if context is None:
        return text
    if isinstance(error, click.MissingParameter):
        text += " " + " ".join(context.get_usage().split())
    return f"{text} ('{context.command_path} --help' explains)"


def _fail(text: str, code: int) -> None:
    click.echo(f"dfcgs: {text}", err=True)
    sys.exit(code)
