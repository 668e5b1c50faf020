"""What a long command shows of itself: a bar on a terminal, lines elsewhere, nothing when it is to be quiet."""

import io
import re
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from cusick_bench.cli.fit.grid_progress import GridProgress, cells_kept
from cusick_bench.cli.progress import Tally, duration, progress_bar
from cusick_bench.cli.screen import Screen
from cusick_bench.cli.verbosity import messages, tell_less
from cusick_bench.datasets import load
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, plan


def screen(terminal: bool = False) -> Screen:
    return Screen(file=io.StringIO(), force_terminal=terminal, width=150)


def written(where: Screen) -> str:
    assert isinstance(where.file, io.StringIO)
    return where.file.getvalue()


def _shown(work, total=None, terminal=True, wait=0.0) -> str:
    """What a bar has written by the end of the work."""
    where = screen(terminal)
    with progress_bar("draping", total, screen=where, interval=0.05) as bar:
        work(bar)
        time.sleep(wait)
    return written(where)


def test_a_bar_says_what_is_done_and_how_much_of_it():
    def work(bar):
        bar.advance()
        bar.advance(2)
        bar.say("scoring [bold]\x1b[2J[/]")

    text = _shown(work, 4)
    assert "75%" in text
    assert r"scoring [bold]\x1b[2J[/]" in text  # no style, no command to the terminal


def test_a_total_may_be_known_late():
    assert "%" not in _shown(lambda bar: None)
    assert "20%" in _shown(lambda bar: bar.show(1, 5))


def test_a_log_that_is_coloured_has_lines_all_the_same(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    where = Screen(file=io.StringIO())
    with progress_bar("draping", 2, screen=where, interval=0.02):
        time.sleep(0.1)
    assert "draping: 0 % (0 of 2)" in written(where)
    assert "\x1b[2K" not in written(where)  # no line is drawn over


def test_the_bar_goes_when_the_work_fails():
    where = screen(True)
    with pytest.raises(ZeroDivisionError), progress_bar("draping", 2, screen=where):
        raise ZeroDivisionError
    assert written(where).endswith("\x1b[2K")  # the line is wiped


def test_without_a_terminal_there_are_lines():
    lines = _shown(
        lambda bar: bar.begin("cotton on fire") or bar.begin("wool"), 4, terminal=False, wait=0.4
    ).splitlines()
    assert len(lines) >= 3
    assert set(lines) == {"wool: 25 % (1 of 4), 0 s"}


def test_a_short_command_writes_no_line():
    where = screen()
    with progress_bar("draping", 2, screen=where) as bar:
        bar.advance()
    assert written(where) == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_a_quiet_command_shows_nothing(terminal):
    with messages():
        tell_less(True)
        assert _shown(lambda bar: bar.advance(), 4, terminal=terminal, wait=0.2) == ""
    assert _shown(lambda bar: bar.advance(), 4, terminal=terminal, wait=0.2) != ""


@dataclass
class Clock:
    """A clock that is set by hand."""

    now: float = 0.0

    def __call__(self) -> float:
        return self.now


class TestTimeLeft:
    """The time left is told once enough is done to judge by, and then it is right."""

    def left_after(self, marks, total: float | None = 100.0, now=None):
        clock = Clock()
        tally = Tally("draping", total, clock=clock)
        for clock.now, done in marks:
            tally.mark(done)
        clock.now = clock.now if now is None else now
        return tally.seconds_left()

    def test_nothing_is_said_too_early(self):
        assert self.left_after([]) is None
        assert self.left_after([(60, 1)]) is None  # one step of a hundred, with the start-up in it
        assert self.left_after([(60, 1), (61, 9)]) is None  # within a second
        assert self.left_after([(60, 50)], total=None) is None

    def test_the_start_up_is_left_out(self):
        # 60 s of compilation and one step, then a step a second
        assert self.left_after([(60, 1), (100, 41)]) == pytest.approx(59)

    def test_a_further_stage_is_judged_by_itself(self):
        """A skirt hangs for a minute and then moves for twenty seconds, of which sixteen minutes seemed to be left."""
        assert self.left_after([(1, 10), (60, 100), (61, 1), (62, 4), (71, 34)]) == pytest.approx(0.3 * 66)
        assert self.left_after([(1, 10), (60, 100), (61, 1)]) is None

    def test_it_counts_down_between_steps(self):
        assert self.left_after([(60, 1), (100, 41)], now=110) == pytest.approx(49)
        assert self.left_after([(60, 1), (100, 41)], now=500) == 0

    def test_a_few_long_steps(self):
        assert self.left_after([(60, 1)], total=4) == pytest.approx(180)

    def test_what_was_done_before_says_nothing_of_the_speed(self):
        clock = Clock()
        tally = Tally("cells", 100, 90, clock=clock)  # ninety of them yesterday
        for clock.now, done in [(10, 91), (20, 96)]:
            tally.mark(done)
        assert tally.seconds_left() == pytest.approx(8)
        assert tally.line() == "cells: 96 % (96 of 100), 20 s, about 8 s left"

    def test_what_is_there_already_says_nothing_of_the_speed(self):
        """As of a suite that goes on: thirty cases of two hundred are counted at once, then each takes a minute."""
        counted = [(0.2 + number / 1000, number + 1) for number in range(30)]
        assert self.left_after([*counted, (60, 31)], total=200) is None
        made = [(60 * number, 30 + number) for number in range(1, 12)]
        assert self.left_after([*counted, *made], total=200) == pytest.approx(60 * (200 - 41))

    def test_what_is_there_already_may_come_in_one_step(self):
        """As of an atlas: a thousand of two thousand, then two seconds each."""
        steps = [(2 * number, 1000 + number) for number in range(150)]
        assert self.left_after(steps[:6], total=2000) is None
        assert self.left_after([(0.2, 1000), *steps[1:]], total=2000) == pytest.approx(2 * 851)

    def test_the_time_spent_holds_what_was_there_already(self):
        clock = Clock()
        tally = Tally("cases", 200, clock=clock)
        for clock.now, done in [(1, 30), (61, 31)]:
            tally.mark(done)
        assert tally.line() == "cases: 16 % (31 of 200), 1 min 01 s"


@pytest.mark.parametrize(
    ("seconds", "text"), [(40.4, "40 s"), (130, "2 min 10 s"), (11100, "3 h 05 min"), (60, "1 min 00 s")]
)
def test_times_are_written_in_words(seconds, text):
    assert duration(seconds) == text


@pytest.fixture(scope="module")
def cells(toy_dataset):
    return plan(toy_dataset, solvers=["null:disc"], cloths=["fabric_1"], seeds=[0, 1, 2])


def test_bars_of_a_grid_show_loss_and_failure(cells):
    where = screen(True)
    with GridProgress(where) as grid:
        grid.begin(cells, cells[:2])
        grid.update(cells[0], 0.5, 0.0123, "fitting [red]")
    text = written(where)
    assert "loss 0.0123 fitting [red]" in text
    assert "50 %" in text
    with grid:
        grid.end(cells[0], "failed", "planted failure")
    assert "planted failure" in written(where)


def test_lines_of_a_grid_show_share_and_loss(cells):
    where = screen()
    with GridProgress(where, interval=0.05) as grid:
        grid.begin(cells, cells[:2])
        grid.update(cells[0], 0.5, 0.0123, "fitting")
        grid.update(cells[1], float("nan"), float("inf"), "")
        time.sleep(0.2)
        grid.end(cells[0], "done", "")
    lines = written(where).splitlines()
    assert lines
    assert lines[0].startswith("cells: 50 % (1 of 3), ")
    assert lines[0].endswith("; fabric_1 / null:disc / 0 50 % loss 0.0123 fitting; fabric_1 / null:disc / 1")
    assert cells_kept(grid, Path("runs/a")).startswith("2 of 3 cells are finished and kept in runs/a")
    assert not re.search(r"\x1b", written(where))


def test_a_message_that_comes_after_its_cells_end_does_not_put_it_back(cells):
    """Its bar stayed until the end of the grid."""
    grid = GridProgress(screen())
    grid.begin(cells, cells)
    grid.end(cells[0], "done", "")
    grid.update(cells[0], 1.0, 0.0123, "scoring")
    assert "scoring" not in grid.line()
    grid.begin(cells, cells)
    grid.update(cells[0], 0.5, 0.0123, "fitting")
    assert "fitting" in grid.line()


def test_cells_that_failed_do_not_count_as_finished_and_kept(cells):
    """They are run again when the command is repeated."""
    grid = GridProgress(screen())
    grid.begin(cells, cells[:2])
    grid.end(cells[0], "failed", "planted failure")
    assert cells_kept(grid, Path("runs/a")) == (
        "1 of 3 cells are finished and kept in runs/a, 1 failed and will be run again; what the others have spent is "
        "kept, too"
    )
    assert grid.line().startswith("cells: 67 % (2 of 3), ")


def test_a_grid_is_judged_by_drapes_to_make_rather_than_by_cells(make_lab):
    """Three cells without physics are no time, and draws from a posterior take as long as other drapes."""
    solvers = ["null:disc", "null:copy", "null:random-phase", "homo", "bdp-field,draws=200"]
    settings = ProblemSettings(budget=Budget(forward_equivalents=100))
    grid, data = GridProgress(screen()), load(make_lab([1e-5], samples=2))
    cells = plan(data, solvers=solvers, settings=settings)
    grid.begin(cells, cells)
    for cell in cells[:3]:
        grid.end(cell, "done", "")
    assert grid.line().startswith("cells: 1 % (3 of 5), ")
    grid.update(cells[4], 0.5, 0.01, "")
    assert grid.line().startswith("cells: 38 % (3 of 5), ")
    without_limit = plan(data, solvers=solvers)
    grid.begin(without_limit, without_limit)
    grid.end(without_limit[0], "done", "")
    assert grid.line().startswith("cells: 20 % (1 of 5), ")
