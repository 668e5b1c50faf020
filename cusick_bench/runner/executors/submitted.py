"""Cells as tasks that submitit hands to Slurm, or to processes on this machine (to try the same without a cluster).

A task is a batch of cells, run one after the other. A task that runs into its time limit, or is pre-empted, is put into
the queue again; it passes over the cells that are finished and goes on with the one that was cut off from its journal.
Where a task ends before its cells do, they are submitted once more, each as a task of its own.

submitit keeps the submitted tasks and their logs in OUT/jobs. Only the tasks themselves read from there: whether a cell
is finished is known from its own folder.
"""

import logging
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cusick_bench.runner.environment import cores
from cusick_bench.runner.errors import CellIsRunning, RunnerError
from cusick_bench.runner.executors.pool import work
from cusick_bench.runner.executors.turns import Turns
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.processes import threads_of_new_processes
from cusick_bench.runner.progress import Watcher
from cusick_bench.runner.source import Source, require_unchanged
from cusick_bench.runner.store import RESULT_FILE, Store, disk_errors
from cusick_bench.sim.errors import TimeLimit

CLUSTERS = ("slurm", "local")

MOST_TASKS = 1000  # of an array: Slurm's own default limit
TASKS_A_WORKER = 4  # batches of a worker: the more, the more evenly cells are dealt, the fewer, the fewer starts
REQUEUES = 20  # times that a task may run into its time limit
# Options that this module or submitit reckons with.
WHOLE_NUMBERS = {"time": "minutes", "cpus_per_task": "processors", "signal_delay_s": "seconds"}
SIGNAL_DELAY = 90  # [s] before its time limit that a task is told to stop, unless another is given: submitit's own
SIGNAL_EARLY = 60  # [s] that Slurm may tell it before that (`--signal` in the manual of sbatch)
START = 60  # [s] that a task may take to load its libraries, before which the signal would kill it
MINUTES = {"slurm": 60, "local": 7 * 24 * 60}  # time limit of a task, unless one is given
POLL_SECONDS = {"slurm": 3.0, "local": 0.3}  # between looks at what is finished
# How long a task may be neither in the queue nor finished before it is lost: network file systems show what another
# node has written up to 60 s later (acregmax and acdirmax of NFS).
GRACE_SECONDS = {"slurm": 90.0, "local": 1.0}

_log = logging.getLogger(__name__)


@contextmanager
def _stopping() -> Iterator[None]:
    """The end of a time limit, or a preemption, is a request to stop.

    submitit's handler of the signal puts the task into the queue again and calls `sys.exit`, or raises an ordinary
    error where that may not be or fails, out of whatever runs by then: a cell would take it for its own and be recorded
    as failed, or a solver for a matrix that cannot be factorised. In here it is a TimeLimit, which leaves a cell as it
    is, to be gone on with; outside submitit sees its own.
    """
    from submitit.core.job_environment import JobEnvironment

    number = signal.Signals[f"SIG{JobEnvironment.USR_SIG}"]
    handler = signal.getsignal(number)
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield
        return

    told: BaseException | None = None

    def stop(*arguments: Any) -> None:
        nonlocal told
        try:
            handler(*arguments)
        except (Exception, SystemExit) as error:
            told = error
            raise TimeLimit(str(error)) from error

    signal.signal(number, stop)
    try:
        yield
    except TimeLimit:
        if told is None:
            raise
        raise told from None
    finally:
        signal.signal(number, handler)


@dataclass(frozen=True)
class Batch:
    """A task: cells that are run one after the other.

    Attributes:
        source: Where the data come from.
        cells: What to run.
        out: Results folder.
    """

    source: Source
    cells: tuple[Cell, ...]
    out: Path

    def __call__(self) -> None:
        """Runs the cells; an error that is no cell's own is told when all have been tried.

        A task of an earlier command may still run a cell; it is waited for, and what it has finished is kept.

        Raises:
            RunnerError: Errors that are no cell's own.
            SystemExit: Of submitit: the task ran into its time limit, or was pre-empted, and is in the queue again.
            UncompletedJobError: Of submitit: the task ran into its time limit once more than it may.
        """
        errors: list[str] = []
        turns = Turns(self.cells)
        with _stopping():
            for cell in turns:
                try:
                    work(self.source, cell, self.out)
                except CellIsRunning:
                    turns.put_off(cell)
                except Exception as error:
                    errors.append(f"{cell.solver} on {cell.cloth}, seed {cell.seed}: {error}")
        if errors:
            raise RunnerError("\n".join(errors))

    def checkpoint(self, *arguments: Any, **options: Any) -> Any:
        """Task that submitit queues again at the time limit: the same one, since finished cells are skipped."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self, *arguments, **options)


@dataclass(frozen=True)
class Submitted:
    """Runs cells through submitit.

    Attributes:
        cluster: "slurm", or "local" for processes on this machine.
        workers: Tasks at a time.
        options: What a task asks for, by submitit's names: `time` (minutes), `partition`, `mem`, `cpus_per_task`,
            `account` and so on; "local" knows `time` only.
    """

    cluster: str
    workers: int = 1
    options: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.cluster not in CLUSTERS:
            raise RunnerError(f"unknown executor {self.cluster!r}; use one of process, {', '.join(CLUSTERS)}")
        if self.workers < 1:
            raise RunnerError(f"workers must be >= 1, got {self.workers}")
        for name, unit in WHOLE_NUMBERS.items():
            text = self.options.get(name, "1")
            if not (text.isascii() and text.isdecimal() and int(text) > 0):
                raise RunnerError(f"--job {name} must be a whole number of {unit}, > 0, got {text[:40]!r}; correct it")
        if self.cluster == "slurm":
            self._require_time()

    def _require_time(self) -> None:
        """Refuses a time limit so short that tasks are told to stop while they start, of which they die."""
        delay = int(self.options.get("signal_delay_s", SIGNAL_DELAY))
        minutes, least = int(self.options.get("time", MINUTES["slurm"])), -(-(delay + SIGNAL_EARLY + START) // 60)
        if minutes < least:
            raise RunnerError(
                f"--job time must be >= {least} minutes, got {minutes}: Slurm tells a task of its end up to "
                f"{delay + SIGNAL_EARLY} s before, and a task needs some time to start; give more time, or a smaller "
                "--job signal_delay_s"
            )

    @property
    def death(self) -> str:
        """Record of a cell whose task ended twice before the cell did."""
        what = "ask for more with --job mem=..." if self.cluster == "slurm" else "reduce --workers"
        return f"The cell's task ended before the cell did, probably out of memory; see its log in OUT/jobs, or {what}"

    def run(self, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher) -> list[Cell]:
        """Runs cells.

        Args:
            source: Where the data come from.
            cells: What to run.
            store: Where results lie, on a file system that all nodes see.
            watcher: Called when a cell is finished.

        Returns:
            Cells whose own task ended before them.

        Raises:
            RunnerError: submitit is not installed, there is no Slurm, or it does not take the job.
            DataError: The data have changed since the cells were planned, so that tasks refuse them.
        """
        if not cells:
            return []
        lost = self._once(source, self._dealt(cells), store, watcher)
        return self._once(source, [(cell,) for cell in lost], store, watcher) if lost else []

    def _dealt(self, cells: Sequence[Cell]) -> list[tuple[Cell, ...]]:
        """Cells of each task; on this machine a task a worker, on a cluster some."""
        tasks = self.workers if self.cluster == "local" else min(MOST_TASKS, TASKS_A_WORKER * self.workers)
        tasks = min(tasks, len(cells))
        return [tuple(cells[task::tasks]) for task in range(tasks)]

    def _once(self, source: Source, dealt: Sequence[tuple[Cell, ...]], store: Store, watcher: Watcher) -> list[Cell]:
        """Submits tasks and waits for them; gives the cells that they have not finished."""
        lost: list[Cell] = []
        most = self.workers if self.cluster == "local" else MOST_TASKS
        for first in range(0, len(dealt), most):
            batches = [Batch(source, cells, store.out.resolve()) for cells in dealt[first : first + most]]
            tasks = [_Task(batch, store) for batch in batches]
            with disk_errors(store.out), self._jobs(batches, store) as jobs:
                lost += self._wait(jobs, tasks, watcher)
        if lost:
            require_unchanged(source, (cell.dataset_hash for cell in lost))
        return lost

    @contextmanager
    def _jobs(self, batches: list[Batch], store: Store) -> Iterator[list[Any]]:
        """Jobs of submitit, cancelled where waiting for them is broken off: nothing runs on that nobody waits for."""
        executor = self._executor(store.out / "jobs")
        threads = int(self.options.get("cpus_per_task", 1)) if self.cluster == "slurm" else cores() // self.workers
        try:
            with threads_of_new_processes(max(1, threads)):
                jobs = executor.submit_array(batches)
        except Exception as error:  # submitit has an error of its own for a command that fails
            raise RunnerError(f"{self.cluster} does not take the job: {error}; mend --job") from error
        names = sorted({job.job_id.partition("_")[0] for job in jobs})
        _log.info("submitted %d tasks to %s: %s; logs in %s", len(jobs), self.cluster, names, store.out / "jobs")
        try:
            yield jobs
        except BaseException:
            if self.cluster == "slurm":
                subprocess.run(["scancel", *names], check=False, capture_output=True)
            else:
                for job in jobs:
                    job.cancel()
            raise

    def _executor(self, folder: Path) -> Any:
        try:
            import submitit
        except ImportError as error:
            raise RunnerError(
                f"--executor {self.cluster} needs submitit; install it with `pip install 'cusick-bench[slurm]'`, or "
                "use --shard i/n in a job array of your own"
            ) from error
        asked: dict[str, Any] = {name: int(text) if text.isdecimal() else text for name, text in self.options.items()}
        asked = {"time": MINUTES[self.cluster]} | asked
        if self.cluster == "local":
            if set(asked) - {"time"}:
                raise RunnerError(f"--executor local knows --job time=MINUTES only, got {', '.join(sorted(asked))}")
            executor: Any = submitit.LocalExecutor(folder, max_num_timeout=REQUEUES)
            executor.update_parameters(timeout_min=asked["time"])
            return executor
        try:
            executor = submitit.SlurmExecutor(folder, max_num_timeout=REQUEUES)
            executor.update_parameters(**{"job_name": "cusick-bench", "array_parallelism": self.workers} | asked)
        except (RuntimeError, ValueError, TypeError) as error:
            what = str(error).replace("\n  - ", "; ")
            raise RunnerError(f"{what}; run it where Slurm's commands are, and give --job what sbatch knows") from error
        return executor

    def _wait(self, jobs: list[Any], tasks: "list[_Task]", watcher: Watcher) -> list[Cell]:
        """Waits for tasks; gives the cells of those that ended before them."""
        lost: list[Cell] = []
        open_tasks = list(zip(jobs, tasks, strict=True))
        while open_tasks:
            time.sleep(POLL_SECONDS[self.cluster])
            queued = self._queued([job for job, _ in open_tasks])
            still = []
            for job, task in open_tasks:
                ended = job.job_id not in queued  # asked for before its cells are looked at
                task.tell(watcher)
                if task.left and task.gone_seconds(ended) < GRACE_SECONDS[self.cluster]:
                    still.append((job, task))
                else:
                    lost += task.left
            open_tasks = still
        return lost

    def _queued(self, jobs: list[Any]) -> set[str]:
        """Names of the jobs that wait or run."""
        names = {job.job_id for job in jobs}
        if self.cluster == "local":
            return {job.job_id for job in jobs if not job.done()}
        asked = ",".join(sorted({name.partition("_")[0] for name in names}))
        command = ["squeue", "--noheader", "--array", "--format=%i", f"--jobs={asked}"]
        found = subprocess.run(command, capture_output=True, text=True, check=False)
        if found.returncode and "Invalid job id" not in found.stderr:
            _log.warning("squeue failed (%s); asked again", found.stderr.strip())
            return names
        return set(found.stdout.split())


class _Task:
    """Cells of a task that are not finished yet.

    Attributes:
        left: These cells, in the order in which they are run.
    """

    def __init__(self, batch: Batch, store: Store) -> None:
        self.left = list(batch.cells)
        self._gone_since: float | None = None
        self._store = store
        self._before = {cell.key: self._stamp(cell) for cell in batch.cells}

    def gone_seconds(self, ended: bool) -> float:
        """Since when, without a break, the task has been found to be no longer in the queue; 0 where it is there."""
        now = time.monotonic()
        if not ended:
            self._gone_since = None
        elif self._gone_since is None:
            self._gone_since = now
        return 0.0 if self._gone_since is None else now - self._gone_since

    def tell(self, watcher: Watcher) -> None:
        """Tells of the cells that were finished since."""
        while self.left and (result := self._ended(self.left[0])) is not None:
            watcher.end(self.left.pop(0), result["status"], result["failure"])

    def _ended(self, cell: Cell) -> dict[str, Any] | None:
        """Result of a cell that has ended, by this task or by one of an earlier command; None of one that has not."""
        if self._store.is_done(cell.key):
            return self._store.result(cell.key)
        if self._stamp(cell) == self._before[cell.key]:
            return None
        result = self._store.result(cell.key)
        return None if result["status"] == "done" else result  # done: its marker is about to be written

    def _stamp(self, cell: Cell) -> tuple[int, int] | None:
        """Tells a result from that of an earlier try."""
        try:
            found = (self._store.folder(cell.key) / RESULT_FILE).stat()
        except FileNotFoundError:
            return None
        return found.st_mtime_ns, found.st_ino
