"""A command whose `--help` lists its options by group, and leaves those that few need to `--help-all`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click

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
