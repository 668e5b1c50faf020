"""Help pages: every command and option says what it is, and units stand as they were written."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from cusick_bench.cli import COMMANDS, app

WIDE = {"COLUMNS": "400", "TERMINAL_WIDTH": "400"}


def walk(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield path, command
    for name in command.list_commands(None) if hasattr(command, "list_commands") else ():
        yield from walk(command.get_command(None, name), (*path, name))


EVERY = dict(walk(get_command(app)))


def page(*path: str) -> str:
    outcome = CliRunner().invoke(app, [*path, "--help"], env=WIDE)
    assert outcome.exit_code == 0, outcome.output
    return outcome.output


def test_all_commands_are_walked():
    assert {path[0] for path in EVERY if path} == set(COMMANDS)
    assert ("withheld", "leave-out") in EVERY


@pytest.mark.parametrize("path", EVERY, ids=" ".join)
def test_a_command_and_its_options_say_what_they_are(path):
    command = EVERY[path]
    assert command.help
    silent = [option.name for option in command.params if not getattr(option, "help", "")]
    assert not silent


@pytest.mark.parametrize("path", [("simulate",), ("garment", "skirt")], ids=" ".join)
def test_units_stand_as_they_were_written(path):
    units = set(re.findall(r"\[(?:kg/m2|N/m|N m|m|s)\]", page(*path)))
    assert units >= {"[kg/m2]", "[N m]", "[N/m]", "[m]"}


def test_completion_is_offered_once():
    assert "--install-completion" in page()
    assert "--install-completion" not in page("simulate")
