"""Which commands and machines made the cells of a row."""

import json
from pathlib import Path

from cusick_bench.datasets import load
from cusick_bench.leaderboard import leaderboards, load_cells
from cusick_bench.leaderboard.cells.commands import cells_of_grid, command_record
from cusick_bench.leaderboard.text import provenance
from cusick_bench.leaderboard.verification.submit import rows_of
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, Source, plan, run, shard
from cusick_bench.sim.engine.settings import DrapeSettings


def recorded(command: str, cells: list[str], cores: int = 2) -> dict:
    return {"command": command.split(), "cells": cells, "cores": cores, "platform": "Linux"}


EARLIER = [recorded("/bin/cusick-bench run one", ["a", "b"]), recorded("cusick-bench run two", ["c"], 4)]
RUN = recorded("cusick-bench run three", ["d"]) | {"history": EARLIER}


def test_one_command_that_asked_for_all_cells_is_the_one():
    assert command_record(RUN, ["b"]) == EARLIER[0]
    assert command_record(RUN, ["d"])["command"] == ["cusick-bench", "run", "three"]


def test_several_commands_that_asked_for_them_together_are_all_told():
    found = command_record(RUN, ["c", "a"])
    assert found["command"] == "cusick-bench run one; cusick-bench run two"
    assert (found["cores"], found["platform"]) == ("2; 4", "Linux")


def test_a_command_that_is_not_needed_is_left_out():
    again = RUN | {"history": [*EARLIER, recorded("cusick-bench run four", ["a", "b", "c"])]}
    assert command_record(again, ["a", "c", "d"])["command"] == "cusick-bench run four; cusick-bench run three"


def test_the_cells_of_a_grid_are_those_of_all_its_parts():
    assert cells_of_grid(RUN) == ["d"]
    assert cells_of_grid(RUN | {"grid": ["c", "d"]}) == ["c", "d"]
    assert cells_of_grid({}) == []


def test_records_that_do_not_name_their_cells_leave_the_last_command():
    assert command_record({"command": "cusick-bench run old"}, ["a"]) == {"command": "cusick-bench run old"}


def test_rows_and_boards_of_shards_name_both_commands(toy_data: Path, tmp_path: Path):
    settings = ProblemSettings(vertices=97, drape=DrapeSettings(steps=5), budget=Budget(8))
    cells = plan(load(toy_data), solvers=["null:disc"], settings=settings)
    commands = [f"cusick-bench run --shard {number}/2" for number in (1, 2)]
    for number, command in enumerate(commands, 1):
        run(Source(str(toy_data)), shard(cells, f"{number}/2"), tmp_path, command=command.split())
    found = load_cells(tmp_path)
    (board,) = leaderboards(found)
    assert f"Command: {'; '.join(commands)}." in provenance(board)
    (row,) = rows_of(found, "mine")
    assert row["command"] == "; ".join(commands)
    assert json.loads((tmp_path / "run.json").read_text())["history"]


def test_earlier_records_hold_no_grid_and_no_cells_that_are_asked_for_again(toy_data: Path, tmp_path: Path):
    """They would be nearly all of run.json, and more than is read after some sixty shards of ten thousand cells."""
    settings = ProblemSettings(vertices=97, drape=DrapeSettings(steps=5), budget=Budget(8))
    cells = plan(load(toy_data), solvers=["null:disc"], settings=settings)
    for number in (1, 2, 2):
        run(Source(str(toy_data)), shard(cells, f"{number}/2"), tmp_path, command=[str(number)], grid=cells)
    record = json.loads((tmp_path / "run.json").read_text())
    assert cells_of_grid(record) == [cell.key for cell in cells]
    assert not any("grid" in earlier for earlier in record["history"])
    known = [cell.key for cell in shard(cells, "1/2")]
    assert [earlier.get("cells", []) for earlier in record["history"]] == [known, []]
    assert command_record(record, known)["command"] == ["1"]
