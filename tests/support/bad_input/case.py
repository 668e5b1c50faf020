"""One case of the corpus: what is written, which command reads it, and what has to come of it."""

import json
import re
import resource
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from typer.testing import CliRunner

from cusick_bench.cli import app

LONGEST = 20.0  # [s] of computing that a case may take: an alarm against what runs away, no measure of speed
_LONGEST_WAIT = 180.0  # [s] that it may take on a machine that has other work
_MEMORY = 6 << 30  # [bytes] of address space that a case may ask for, beside what the process has
_GROWTH = 1 << 30  # [bytes] by which its resident memory may grow meanwhile
_MOST_LINES = 6  # of a message
_FRAME = re.compile(r"[\u2500-\u257f]+")  # that typer draws around its messages
_WIDE = {"COLUMNS": "2000", "TERMINAL_WIDTH": "2000", "LC_ALL": "C.UTF-8"}


@dataclass(frozen=True)
class Stock:
    """What cases are made of, written once; each works on a copy.

    Attributes:
        lab: Data set of one fabric and three samples, with meshes, `fabrics.csv` and no `protocol.json`.
        run: Finished run on it: `null:disc` and a small `homo`.
        atlas: Folder that holds nothing but a copy of the installed atlas.
    """

    lab: Path
    run: Path
    atlas: Path

    def copy_lab(self, here: Path) -> Path:
        """A copy of the data set in the folder of a case."""
        return Path(shutil.copytree(self.lab, here / "lab"))

    def copy_run(self, here: Path) -> Path:
        """A copy of the run, and of its data set, in the folder of a case."""
        self.copy_lab(here)
        return Path(shutil.copytree(self.run, here / "run"))


@dataclass(frozen=True)
class Outcome:
    """What a command has done.

    Attributes:
        code: Exit status.
        output: Standard output.
        message: Standard error, without frames, on one line.
        lines: Number of its lines.
        here: Folder of the case.
    """

    code: int
    output: str
    message: str
    lines: int
    here: Path

    @property
    def document(self) -> Any:
        """Standard output as JSON."""
        return json.loads(self.output)


def _nothing(here: Path, stock: Stock) -> None:
    """Writes nothing: the command line itself is bad."""


def _done(outcome: Outcome) -> bool:
    return True


@dataclass(frozen=True)
class Case:
    """A bad or odd input.

    Attributes:
        name: What is odd about it.
        command: Command line, `{here}` being the folder of the case.
        write: Writes the input into that folder.
        refused: Pattern of the message with which it is refused, exit status 2; empty where it is read.
        right: Whether the answer is right, where it is read.
        codes: Exit status; by default 0 where it is read, 2 where it is refused.
        awaits: What the project still lacks for it, empty where nothing.
    """

    name: str
    command: str
    write: Callable[[Path, Stock], object] = _nothing
    refused: str = ""
    right: Callable[[Outcome], bool] = _done
    codes: tuple[int, ...] = ()
    awaits: str = ""


def run_case(case: Case, here: Path, stock: Stock) -> None:
    """Tries a case, and asserts what every case promises, and what this one does."""
    case.write(here, stock)
    words = [word.replace("{here}", str(here)).replace("{space}", " ") for word in case.command.split(" ") if word]
    before = _resident()
    with _memory_limit(), _alarm():
        result = CliRunner().invoke(app, words, env=_WIDE)
    grown = _resident(peak=True) - before
    error = result.exception
    assert error is None or isinstance(error, SystemExit), f"{type(error).__name__} left the command: {error}"
    lines = [line for line in _FRAME.sub(" ", result.stderr).splitlines() if line.strip()]
    message = " ".join(" ".join(lines).split())
    outcome = Outcome(result.exit_code, result.stdout, message, len(lines), here)
    assert grown < _GROWTH, f"memory grew by {grown >> 20} MiB"
    assert "Traceback" not in result.output + result.stderr
    if "--json" in words and outcome.output.strip():
        assert outcome.document is not None  # one document, or none at all
    assert not any(ord(letter) < 32 and letter not in "\n\t" for letter in result.output + result.stderr), (
        f"control characters reach the terminal: {(result.output + result.stderr)!r}"
    )
    if case.refused:
        _check_refusal(case, outcome)
    else:
        assert outcome.code in (case.codes or (0,)), f"exit status {outcome.code}: {message}"
        assert case.right(outcome), f"another answer than the right one: {outcome.output[:1000]} {message[:1000]}"


def _check_refusal(case: Case, outcome: Outcome) -> None:
    told = f"{outcome.message} {outcome.output[:300]}"
    assert outcome.code in (case.codes or (2,)), f"exit status {outcome.code} instead of a refusal: {told}"
    assert outcome.code == 1 or not outcome.output.strip(), f"it was refused, and printed {outcome.output[:200]}"
    assert re.search(case.refused, outcome.message), f"the message does not hold {case.refused!r}: {outcome.message}"
    assert outcome.lines <= _MOST_LINES, f"the message has {outcome.lines} lines: {outcome.message[:500]}"
    assert len(outcome.message) < 1500, f"the message has {len(outcome.message)} letters: {outcome.message[:500]}"


@contextmanager
def _memory_limit() -> Iterator[None]:
    """Whoever asks for far more memory than a case needs gets none of it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + _MEMORY, hard))
    Path("/proc/self/clear_refs").write_text("5")  # the peak of resident memory starts anew
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _resident(*, peak: bool = False) -> int:
    name = "VmHWM" if peak else "VmRSS"
    line = next(row for row in Path("/proc/self/status").read_text().splitlines() if row.startswith(name))
    return int(line.split()[1]) << 10


class TooLong(BaseException):
    """A case has taken too long; no command may catch this."""


@contextmanager
def _alarm() -> Iterator[None]:
    def ring(number: int, frame: FrameType | None) -> None:
        raise TooLong(f"it computed more than {LONGEST:g} s or took more than {_LONGEST_WAIT:g} s")

    assert threading.current_thread() is threading.main_thread()
    alarms = {signal.ITIMER_PROF: (signal.SIGPROF, LONGEST), signal.ITIMER_REAL: (signal.SIGALRM, _LONGEST_WAIT)}
    before = {number: signal.signal(number, ring) for number, _ in alarms.values()}
    for timer, (_, seconds) in alarms.items():
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for timer in alarms:
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
