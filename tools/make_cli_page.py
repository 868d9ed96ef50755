"""Write `docs/cli.md` from the commands' own definitions: `python tools/make_cli_page.py`."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click

from dfcgs_codec.cli import cli
from dfcgs_codec.cli.encode_options import GroupedCommand

PAGE = Path(__file__).resolve().parents[1] / "docs" / "cli.md"
_WIDTH = 120
_HEAD = """# The command line

<!-- written by `make cli-page` from the definitions in src/dfcgs_codec/cli/: edit those -->

`dfcgs` has five commands. `--help` behind each of them says what stands here, `dfcgs encode --help-all` with
the last group of options, which few need.

From Python, options of `encode` are fields of `EncoderOptions` and `InputPolicy`, and arguments of
`open_folder`. How the encoder works inside can be changed from Python only, for experiments: by the fields of
[`EncoderTuning`](../src/dfcgs_codec/encoder/plan/tuning.py), which says what each was measured to be worth.

Data goes to standard output; notes, progress and errors go to standard error. An error is one line that says
what is wrong and what to do. Exit codes: 0 done, 1 failed, 2 the command line was wrong, 3 the file to decode
was refused.
"""


def _plain(text: str | None) -> str:
    """A text of the definitions on one line."""
    return " ".join(inspect.cleandoc(text or "").split())


def _value(option: click.Option) -> str:
    """What stands behind the option: nothing for a flag."""
    if option.is_flag:
        return ""
    if isinstance(option.type, click.Choice):
        return f" {'|'.join(option.type.choices)}"
    kind = "TEXT" if option.type.name == "text" else "NUMBER"
    return f" {option.metavar or kind}"


def _default(option: click.Option) -> str:
    if isinstance(option.show_default, str):
        return f" (default: {option.show_default})"
    return f" (default: `{option.default}`)" if option.show_default else ""


def _items(options: Sequence[click.Option]) -> Iterator[str]:
    for option in options:
        names = ", ".join(sorted(option.opts, key=len, reverse=True))
        yield f"- `{names}{_value(option)}`{_default(option)}:"
        yield textwrap.fill(_plain(option.help), _WIDTH, initial_indent="  ", subsequent_indent="  ")


def _groups(command: click.Command) -> Mapping[str, Sequence[click.Option]]:
    if isinstance(command, GroupedCommand):
        return command.groups
    return {"Options": [option for option in command.params if isinstance(option, click.Option)]}


def _argument(argument: click.Argument) -> str:
    name = argument.metavar or (argument.name or "").upper()
    return name if argument.required or argument.metavar else f"[{name}]"


def _section(name: str, command: click.Command) -> Iterator[str]:
    arguments = [_argument(one) for one in command.params if isinstance(one, click.Argument)]
    yield from (f"## dfcgs {name}", "", f"    dfcgs {name} [OPTIONS] {' '.join(arguments)}", "")
    yield from (_plain(command.help), "")
    for title, options in _groups(command).items():
        yield from (f"### {title}", "", *_items(options), "")
    examples = inspect.cleandoc(command.epilog or "").replace("\b", "").strip().splitlines()[1:]
    yield from ("### Examples", "", *(f"    {line.strip()}" for line in examples), "")


def page() -> str:
    """The text of the page."""
    context = click.Context(cli)
    lines = [_HEAD]
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        lines += _section(name, command)
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page())
