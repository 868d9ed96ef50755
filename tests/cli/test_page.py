"""`docs/cli.md` is what the commands say of themselves."""

from __future__ import annotations

import click

from dfcgs_codec.cli import cli
from tools.make_cli_page import PAGE, page


def test_the_page_is_up_to_date() -> None:
    assert page() == PAGE.read_text(), "run `make cli-page`"


def test_every_option_of_every_command_stands_in_it() -> None:
    sections = page().split("\n## dfcgs ")[1:]
    assert [section.split("\n")[0] for section in sections] == ["encode", "decode", "info", "view", "export"]
    context = click.Context(cli)
    for section in sections:
        command = cli.get_command(context, section.split("\n")[0])
        assert command is not None
        for option in command.params:
            if isinstance(option, click.Option) and option.opts != ["--help-all"]:
                assert f"\n- `{max(option.opts, key=len)}" in section
