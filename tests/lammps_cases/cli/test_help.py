"""The list of commands: one line of help each, written in one place."""

from __future__ import annotations

import click
import pytest

from lammps_cases.cli.main import COMMANDS, group


@pytest.mark.parametrize("name", COMMANDS)
def test_command_list_uses_the_line_of_the_table(name: str) -> None:
    context = click.Context(group)
    command = group.get_command(context, name)
    assert command is not None
    assert (command.name, command.get_short_help_str(limit=120)) == (name, COMMANDS[name][1])
