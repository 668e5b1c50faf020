"""What a long command shows of itself: on a terminal what is done and what is left, elsewhere nothing."""

import io

import pytest
from rich.console import Console

from cusick_bench.cli import common
from cusick_bench.cli.common import progress_bar


@pytest.fixture
def screen(monkeypatch):
    """Makes standard error a terminal, or none, and returns what is written to it."""

    def make(terminal: bool) -> io.StringIO:
        written = io.StringIO()
        monkeypatch.setattr(common, "console", Console(file=written, force_terminal=terminal, width=120))
        return written

    return make


def _shown(screen, work, total=None) -> str:
    """Last state of a bar on a terminal."""
    written = screen(True)
    with progress_bar("draping", total) as bar:
        work(bar)
        bar._progress.refresh()
        return written.getvalue().rsplit("\x1b[1A", 1)[-1]


def test_a_bar_says_what_is_done_and_how_much_of_it(screen):
    def work(bar):
        bar.advance()
        bar.advance(2)
        bar.say("scoring")

    text = _shown(screen, work, 4)
    assert "scoring" in text
    assert "75%" in text


def test_a_total_may_be_known_late(screen):
    assert "%" not in _shown(screen, lambda bar: None)
    assert "20%" in _shown(screen, lambda bar: bar.show(1, 5))


def test_nothing_is_written_where_nobody_looks(screen):
    written = screen(False)
    with progress_bar("draping", 2) as bar:
        bar.advance()
    assert written.getvalue() == ""


def test_the_bar_goes_when_the_work_fails(screen):
    written = screen(True)
    with pytest.raises(ZeroDivisionError), progress_bar("draping", 2):
        raise ZeroDivisionError
    assert written.getvalue().endswith("\x1b[2K")  # the line is wiped
