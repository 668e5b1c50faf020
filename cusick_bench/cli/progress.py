"""Progress of a long command: a bar on a terminal, elsewhere a line every ten seconds, nothing with `--quiet`.

All of it goes to standard error. The time left is shown once enough work is done for an estimate.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from cusick_bench.cli import common
from cusick_bench.cli.screen import Screen, harmless

INTERVAL = 10.0  # [s] between two lines where there is no terminal
JUDGED_SHARE = 0.05  # least share of the work from which the speed is estimated
JUDGED_FROM_START = 0.1  # the same, where the start-up is included
JUDGED_SECONDS = 5.0  # [s] least time of work from which the speed is estimated
AT_ONCE = 20.0  # times faster than the next step: what an earlier command has done, and this one only counts


@dataclass
class Tally:
    """Work that is done, and how long it took.

    Attributes:
        what: What is being done.
        total: All work, in the same unit as `done`; None if not known yet.
        done: What is done of it.
        begun: Steps that were begun, where steps are told when they begin.
        clock: Seconds of a clock.
    """

    what: str
    total: float | None = None
    done: float = 0.0
    begun: int = 0
    clock: Callable[[], float] = time.monotonic
    _began: float = field(init=False)
    _marks: list[tuple[float, float]] = field(default_factory=list)  # start, first progress, last progress

    def __post_init__(self) -> None:
        self._began = self.clock()
        self._marks.append((self._began, self.done))

    def mark(self, done: float) -> None:
        """So much is done in all.

        Args:
            done: In the unit of `total`.
        """
        now = self.clock()
        if done < self.done:  # another stage, which begins anew
            self._marks = [(now, done)]
        elif done > self.done:
            if self._was_counted(now, done):
                self._marks = [self._marks[-1]]
            self._marks = [*self._marks[:2], (now, done)]
        self.done = done

    def _was_counted(self, now: float, done: float) -> bool:
        """Whether the steps before this one were no work, since they took next to no time beside it."""
        (start, before), (last, made) = self._marks[0], self._marks[-1]
        return done > made and (now - last) * (made - before) > AT_ONCE * (last - start) * (done - made)

    def seconds(self) -> float:
        """Time since the work began [s]."""
        return self.clock() - self._began

    def seconds_left(self) -> float | None:
        """Estimated time for the rest of the work [s]; None while too little is done for an estimate.

        As soon as possible the speed is estimated without the start-up, in which libraries are loaded and compiled.
        What an earlier command has done, or a journal repeats, tells nothing of the speed.
        """
        if not self.total or len(self._marks) < 2:
            return None
        now, (last, done) = self.clock(), self._marks[-1]
        for (first, before), share in ((self._marks[1], JUDGED_SHARE), (self._marks[0], JUDGED_FROM_START)):
            if done - before >= share * self.total and last - first >= JUDGED_SECONDS:
                return max(0.0, (self.total - done) * (last - first) / (done - before) - (now - last))
        return None

    def line(self, counted: str | None = None) -> str:
        """What a log shows: the share done, the time spent, the time left.

        Args:
            counted: How many steps are done of how many, in words, where these are unlike.
        """
        words, left = [duration(self.seconds())], self.seconds_left()
        if self.total:
            share = min(1.0, self.done / self.total)
            words.insert(0, f"{100 * share:.0f} % ({counted or f'{int(self.done)} of {int(self.total)}'})")
        if left:
            words.append(f"about {duration(left)} left")
        return f"{self.what}: {', '.join(words)}"


def duration(seconds: float) -> str:
    """A time in words, rounded as a reader wants it.

    Args:
        seconds: The time [s].

    Returns:
        Text such as `40 s`, `2 min 10 s`, `3 h 05 min`.
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


class Lines:
    """Prints a line every few seconds as long as it is open; a context manager."""

    def __init__(self, line: Callable[[], str], screen: Screen, interval: float) -> None:
        self._line, self._screen, self._interval = line, screen, interval
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._print, daemon=True)

    def __enter__(self) -> "Lines":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _print(self) -> None:
        while not self._over.wait(self._interval):
            self._screen.print(self._line(), soft_wrap=True)


def live(screen: Screen) -> bool:
    """Whether a bar can move there: on a terminal that steers its cursor."""
    return screen.on_terminal and not screen.is_dumb_terminal


@dataclass(frozen=True)
class Bar:
    """Progress of a command, as it is shown.

    Attributes:
        tally: How far it is.
        changed: Called after every change.
    """

    tally: Tally
    changed: Callable[[], None]

    def advance(self, count: float = 1) -> None:
        """So much more is done."""
        self.show(self.tally.done + count)

    def show(self, done: float, total: float | None = None) -> None:
        """So much is done in all, of a total that may only be known now."""
        if total is not None:
            self.tally.total = total
        self.tally.mark(done)
        self.changed()

    def begin(self, what: str) -> None:
        """The next step begins; all before it are done."""
        self.tally.what = what
        self.show(self.tally.begun)
        self.tally.begun += 1

    def say(self, what: str) -> None:
        """Says what is being done now."""
        self.tally.what = what
        self.changed()

    def tell(self, what: str, done: float, total: float | None = None) -> None:
        """Says what is being done now, and how much is done (see `show`)."""
        self.say(what)
        self.show(done, total)


@contextmanager
def progress_bar(
    what: str, total: float | None = None, *, screen: Screen | None = None, interval: float = INTERVAL
) -> Iterator[Bar]:
    """Shows the progress of a command on standard error: a bar that vanishes when the work is done, or lines.

    Args:
        what: What is being done.
        total: Number of steps, None if not known yet.
        screen: Where it is shown; by default on standard error.
        interval: Time between two lines [s].
    """
    screen, tally = screen or common.console, Tally(what, total)
    if common.quiet():
        yield Bar(tally, lambda: None)
    elif live(screen):
        columns = (
            TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(),
            "left", TimeRemainingColumn(),
        )  # fmt: skip
        with Progress(*columns, console=screen, transient=True) as progress:
            task = progress.add_task(harmless(what), total=total)

            def changed() -> None:
                progress.update(task, description=harmless(tally.what), completed=tally.done, total=tally.total)

            yield Bar(tally, changed)
    else:
        with Lines(tally.line, screen, interval):
            yield Bar(tally, lambda: None)
