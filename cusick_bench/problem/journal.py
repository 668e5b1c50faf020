"""Memory of a run that may be killed: every evaluation is kept, and a resumed solver is fed from it.

Solvers are deterministic given their generator and the losses they see. So a resumed run starts its solver
anew and answers from the journal until that ends; from there on it computes, and ends with the numbers of an
undisturbed run. No solver needs to know how to save itself. One that holds much state (or much time outside
of evaluations) may save it in the `Checkpoint` beside.

`trace.jsonl` has one line an evaluation, `state.bin` the float64 arrays that belong to it (gradient,
vertices). The line is written last: what a kill cut short has no line and is dropped.
"""

import json
import math
import os
from dataclasses import asdict, dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np

from cusick_bench.problem.budget import GRADIENTS, Evaluation
from cusick_bench.problem.errors import ProblemError

TRACE, ARRAYS, STATE = "trace.jsonl", "state.bin", "state.npz"

# Longer arrays are not journalled (2 MB a gradient of the heterogeneous space): their solvers use the
# checkpoint.
LONGEST = 100_000  # numbers


@dataclass(frozen=True)
class Entry:
    """An evaluation with its arrays: `gradient` (dimension,) and `vertices` (V, 3) where there are such."""

    evaluation: Evaluation
    arrays: dict[str, np.ndarray]


def _line(entry: Entry) -> str:
    """The trace's line of an entry. JSON has no infinity: a failed evaluation's loss is null."""
    record: dict[str, Any] = asdict(entry.evaluation)
    record = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in record.items()}
    record["arrays"] = {name: list(array.shape) for name, array in entry.arrays.items()}
    return json.dumps(record) + "\n"


def _evaluation(record: dict[str, Any]) -> Evaluation:
    names = Evaluation.__dataclass_fields__
    values = {name: record[name] for name in names if name in record}
    for name in ("loss", "best_loss"):
        values[name] = math.inf if values[name] is None else values[name]
    return Evaluation(**values)


def read_trace(folder: Path) -> list[dict[str, Any]]:
    """Reads the complete lines of a folder's trace; a last line that a kill cut short is left out.

    Args:
        folder: Folder of the run.

    Returns:
        One record a line.
    """
    path = folder / TRACE
    if not path.exists():
        return []
    records = []
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        if not line.endswith("\n"):
            break
        records.append(json.loads(line))
    return records


@dataclass
class Journal:
    """Evaluations of one cell, kept in a folder, or in nothing where `folder` is None.

    Attributes:
        folder: Folder that holds `trace.jsonl` and `state.bin`.
    """

    folder: Path | None = None
    _past: list[Entry] = field(default_factory=list, init=False)
    _position: int = field(default=0, init=False)
    _trace: TextIO | None = field(default=None, init=False)
    _arrays: BinaryIO | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        self._past = self._load(self.folder)
        self._open(self._past)

    @staticmethod
    def _load(folder: Path) -> list[Entry]:
        """Complete entries of an earlier run."""
        path = folder / ARRAYS
        data = np.fromfile(path, dtype="<f8", count=path.stat().st_size // 8) if path.exists() else np.zeros(0)
        entries, begin = [], 0
        for record in read_trace(folder):
            arrays = {}
            for name, shape in record["arrays"].items():
                end = begin + math.prod(shape)
                if end > len(data):
                    return entries
                arrays[name] = data[begin:end].reshape(shape)
                begin = end
            entries.append(Entry(_evaluation(record), arrays))
        return entries

    def _open(self, entries: list[Entry]) -> None:
        """Cuts both files to the given entries, the trace atomically, and opens them to append."""
        assert self.folder is not None
        self.close()
        part = self.folder / (TRACE + ".part")
        part.write_text("".join(_line(entry) for entry in entries), encoding="utf-8")
        os.replace(part, self.folder / TRACE)
        self._trace = (self.folder / TRACE).open("a", encoding="utf-8")
        self._arrays = (self.folder / ARRAYS).open("ab")
        os.truncate(self.folder / ARRAYS, 8 * sum(array.size for entry in entries for array in entry.arrays.values()))

    @property
    def replaying(self) -> bool:
        """Whether evaluations of an earlier run are left."""
        return self._position < len(self._past)

    def next(self, kind: str, digest: str) -> Entry | None:
        """The earlier run's evaluation that this one repeats.

        Args:
            kind: What is asked for: a loss, a gradient, a drape.
            digest: Hash of the parameters it is asked for.

        Returns:
            The earlier run's entry; None where that run had got no further.

        Raises:
            ProblemError: The earlier run asked for something else here, so the folder belongs to another run.
        """
        if not self.replaying:
            return None
        entry = self._past[self._position]
        past = entry.evaluation
        if (past.kind, past.digest) != (kind, digest):
            raise ProblemError(
                f"evaluation {self._position} in {self.folder} is a {past.kind} at other parameters than the "
                f"{kind} asked for now: the solver or the machine changed; delete that folder to start afresh"
            )
        if kind in GRADIENTS and not past.failure and "gradient" not in entry.arrays:
            raise ProblemError(
                f"the gradients of {self.folder} were too long to be kept, and its solver saved no state "
                "of its own; delete that folder to start afresh"
            )
        self._position += 1
        return entry

    def rewind(self, evaluations: int) -> list[Entry]:
        """Keeps the first `evaluations` entries of the earlier run, without replaying them.

        For solvers that go on from their own checkpoint instead of being fed from the journal. Drapes that follow
        are replayed, if there is a checkpoint; whatever else follows is forgotten.

        Args:
            evaluations: Number of entries that are kept.

        Returns:
            The entries kept.
        """
        done, rest = self._past[:evaluations], self._past[evaluations:]
        drapes = takewhile(lambda entry: entry.evaluation.kind in ("drape", "draw"), rest if done else [])
        self._past, self._position = done + list(drapes), len(done)
        if self.folder is not None:
            self._open(self._past)
        return done

    def append(self, entry: Entry) -> None:
        """Keeps an evaluation; once this returns, a kill of the process does not lose it.

        Args:
            entry: The evaluation.
        """
        if self._trace is None or self._arrays is None:
            return
        kept = Entry(entry.evaluation, {k: v for k, v in entry.arrays.items() if v.size <= LONGEST})
        for array in kept.arrays.values():
            self._arrays.write(np.ascontiguousarray(array, dtype="<f8").tobytes())
        self._arrays.flush()
        self._trace.write(_line(kept))
        self._trace.flush()

    def close(self) -> None:
        """Closes the files."""
        for file in (self._trace, self._arrays):
            if file is not None:
                file.close()


@dataclass(frozen=True)
class Checkpoint:
    """A solver's own state in `state.npz`, replaced atomically; kept nowhere where `folder` is None.

    Attributes:
        folder: The cell's folder.
    """

    folder: Path | None = None

    def save(self, **arrays: np.ndarray) -> None:
        """Replaces the state."""
        if self.folder is None:
            return
        part = self.folder / (STATE + ".part")
        with part.open("wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
        os.replace(part, self.folder / STATE)

    def load(self) -> dict[str, np.ndarray] | None:
        """The state saved last, or None."""
        if self.folder is None or not (self.folder / STATE).exists():
            return None
        with np.load(self.folder / STATE, allow_pickle=False) as archive:
            return dict(archive)
