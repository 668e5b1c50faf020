"""Help pages: every command and option says what it is, and units stand as they were written."""

import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from cusick_bench.cli import COMMANDS, PANELS, app
from cusick_bench.garment.skirt import MINIMUM_VERTICES

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


@pytest.mark.parametrize("name", ["skirt", "compare"])
def test_the_least_vertices_of_a_skirt_are_those_of_its_help_page(name):
    (option,) = (one for one in EVERY["garment", name].params if one.opts[0] == "--vertices")
    assert f"{MINIMUM_VERTICES} or more" in option.help


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


PAGE = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")


def test_every_command_prints_json_where_it_is_asked_to():
    leaves = {path: command for path, command in EVERY.items() if not hasattr(command, "list_commands")}
    assert len(leaves) > 40
    assert [path for path, command in leaves.items() if "--json" not in _options(command)] == []


def test_devices_and_seeds_are_for_the_commands_that_the_page_names():
    having = {
        name: {" ".join(path) for path, command in EVERY.items() if name in _options(command)}
        for name in ("--device", "--seed")
    }
    (alone,) = re.findall(r"Only `(\w+)` and `(\w+)` have `--device`", " ".join(PAGE.split()))
    assert having["--device"] == set(alone)
    fixed = re.search(r"nor do those whose random numbers belong to what they make: (.*?)\. ", " ".join(PAGE.split()))
    assert fixed is not None
    named = set(re.findall(r"`([a-z][a-z -]+)`", fixed[1]))
    assert {"data synthetic", "atlas build", "population"} <= named <= {" ".join(path) for path in EVERY}
    assert not having["--seed"] & named


def test_default_numbers_of_vertices_are_those_of_the_page():
    """`run`, `simulate` and commands of several meshes, which have none, are looked at where they run."""
    rows = re.findall(r"^\| (`.+?) \| `\w+`(?:, fixed)? \| ([\d, ]+) \|$", PAGE, re.M)
    told = {}
    for names, numbers in rows:
        commands = re.findall(r"`([^`]+)`", names)
        group = commands[0].rpartition(" ")[0]
        paths = [tuple(f"{group} {name.removeprefix(group)}".split()) for name in commands]
        every = [int(number) for number in numbers.split(", ")]
        told |= dict(zip(paths, every * len(paths) if len(every) == 1 else every, strict=len(every) > 1))
    assert set(told) >= {("identify",), ("learning-curve",), ("population",), ("paper", "table-2")}
    found = {path: next(o.default for o in EVERY[path].params if o.opts[0] == "--vertices") for path in told}
    assert found == told


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
