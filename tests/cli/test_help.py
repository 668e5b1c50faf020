"""Help pages: every command and option says what it is, and units stand as they were written."""

import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from cusick_bench.cli import COMMANDS, PANELS, app

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


def _options(command):
    """Names of a command's options with the panel that each stands in."""
    return {
        option.opts[0]: getattr(option, "rich_help_panel", None)
        for option in command.params
        if option.opts[0].startswith("--") and option.name not in ("quiet", "verbose")  # which every command has
    }


def test_commands_stand_in_panels():
    text = page()
    places = [text.index(f" {panel} ") for panel in PANELS]
    assert places == sorted(places)
    for name in COMMANDS:
        assert re.search(rf"│ {name} ", text), name
    assert "─ Commands ─" not in text


@pytest.mark.parametrize("path", [path for path in EVERY if len(_options(EVERY[path])) > 10], ids=" ".join)
def test_many_options_stand_in_panels(path):
    """More than ten options are no list that anybody reads."""
    loose = [name for name, panel in _options(EVERY[path]).items() if panel is None]
    assert not loose


FORMER = {"--without", "--method", "--spread", "--least", "--redraws", "--rest"}


def test_one_name_means_one_thing():
    """An option of one name has one type wherever it stands, and names that were given up are not back."""
    types: dict[str, set[Any]] = defaultdict(set)
    for command in (command for command in EVERY.values() if command.callback is not None):
        hints = get_type_hints(command.callback)
        for option in command.params:
            if option.opts[0].startswith("--") and option.name in hints:
                hint = hints[option.name]
                types[option.opts[0]] |= set(get_args(hint) or (hint,)) - {type(None)}
    differing = {name: found for name, found in types.items() if len(found) > 1}
    # several of these may be given: mesh sizes of a table, files of a leaderboard; one stiffness is a number
    assert set(differing) == {"--vertices", "--out", "--bending"}
    assert not types.keys() & FORMER


def test_completion_is_offered_once():
    assert "--install-completion" in page()
    assert "--install-completion" not in page("simulate")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulat"], "did you mean 'simulate'?"),
        (["run", "--sover", "homo"], "--solver"),
        (["diagnose", "--without-effect", "crep"], "did you mean 'creep'?"),
        (["run", "--out", "OUT", "--solver", "hommo"], "did you mean 'homo'?"),
        (["run", "--out", "OUT", "--cloth", "fabric_11", "--solver", "homo"], "did you mean 'fabric_1'?"),
        (["data", "info", "sinthetic"], "did you mean 'synthetic'?"),
    ],
)
def test_a_slip_is_answered_with_the_nearest_name(arguments, message, tmp_path):
    result = CliRunner().invoke(app, [str(tmp_path) if word == "OUT" else word for word in arguments], env=WIDE)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())


def test_the_package_is_run_as_a_program():
    done = subprocess.run([sys.executable, "-m", "cusick_bench", "--help"], capture_output=True, text=True, check=True)
    assert "simulate" in done.stdout
