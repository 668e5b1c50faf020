"""Memory of a run that may be killed: every evaluation is kept, and a resumed solver is fed from it.

Solvers are deterministic given their generator and the losses they see. So a resumed run starts its solver
anew and answers from the journal until that ends; from there on it computes, and ends with the numbers of an
undisturbed run. No solver needs to know how to save itself. One that holds much state (or much time outside
of evaluations) may save it in the `Checkpoint` beside.

`trace.jsonl` has one line an evaluation, `state.bin` the float64 arrays that belong to it (gradient,
vertices). The line is written last: what a kill cut short has no line and is dropped. Each line ends with a hash of
itself, its arrays and the line before, the first with one of the cell's name: an evaluation is replayed only where
all that led to it is what was written, and a checkpoint is taken up only on the evaluations that it was saved after.
Whatever is damaged is computed again.
"""

import hashlib
import json
import logging
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import accumulate, takewhile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cusick_bench.files import parse_json
from cusick_bench.files.plain_names import part_of
from cusick_bench.problem.errors import StaleJournal
from cusick_bench.problem.metering.budget import Evaluation

_log = logging.getLogger(__name__)

TRACE, ARRAYS, STATE = "trace.jsonl", "state.bin", "state.npz"
_CHECK = ', "check": "'  # what the hash of a line stands after, as the last of its entries
_DIGITS = 16  # hexadecimal, of a line's hash
_DIGEST_BYTES = hashlib.sha256().digest_size

# Longer arrays are not journalled (2 MB a gradient of the heterogeneous space): their solvers use the
# checkpoint.
LONGEST = 100_000  # numbers
_NEEDED = ("vertices",)  # drapes, of which a solver has no other record, are journalled however long they are


@dataclass(frozen=True)
class Entry:
    """An evaluation with its arrays: `gradient` (dimension,) and `vertices` (V, 3) where there are such."""

    evaluation: Evaluation
    arrays: dict[str, np.ndarray]


def _body(entry: Entry) -> str:
    """The trace's line of an entry, without its hash. JSON has no infinity: a failed evaluation's loss is null."""
    record: dict[str, Any] = asdict(entry.evaluation)
    record = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in record.items()}
    record["arrays"] = {name: list(array.shape) for name, array in entry.arrays.items()}
    return json.dumps(record)


def _bytes(array: np.ndarray) -> bytes:
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def _first_link(identity: str) -> str:
    return hashlib.sha256(identity.encode()).hexdigest()[:_DIGITS]


def _link(before: str, body: str, arrays: dict[str, np.ndarray]) -> str:
    """Hash of a line, its arrays and, by the hash of the line before, of everything before."""
    digest = hashlib.sha256(f"{before}{body}".encode())
    for array in arrays.values():
        digest.update(_bytes(array))
    return digest.hexdigest()[:_DIGITS]


def _line(body: str, link: str) -> str:
    return f'{body[:-1]}{_CHECK}{link}"}}\n'


def _evaluation(record: dict[str, Any]) -> Evaluation:
    names = Evaluation.__dataclass_fields__
    values = {name: record[name] for name in names if name in record}
    for name in ("loss", "best_loss"):
        values[name] = math.inf if values[name] is None else values[name]
    return Evaluation(**values)


def read_trace(folder: Path) -> list[dict[str, Any]]:
    """Reads a folder's trace as far as it can be read: a last line that a kill cut short is left out.

    Args:
        folder: Folder of the run.

    Returns:
        One record a line.
    """
    records: list[dict[str, Any]] = []
    for line in _lines(folder / TRACE):
        try:
            record = parse_json(line.decode(), TRACE, remedy="")
        except ValueError:
            break
        if not isinstance(record, dict):
            break
        records.append(record)
    return records


def _lines(path: Path) -> Iterator[bytes]:
    """Complete lines of a file; none where there is no file."""
    if path.exists():
        yield from takewhile(lambda line: line.endswith(b"\n"), path.read_bytes().splitlines(keepends=True))


@dataclass
class Journal:
    """Evaluations of one cell, kept in a folder, or in nothing where `folder` is None.

    Attributes:
        folder: Folder that holds `trace.jsonl` and `state.bin`.
        identity: Name of the cell; evaluations that were kept under another one are not taken up.
    """

    folder: Path | None = None
    identity: str = ""
    _past: list[Entry] = field(default_factory=list, init=False)
    _links: list[str] = field(default_factory=list, init=False)
    _position: int = field(default=0, init=False)
    _trace: BinaryIO | None = field(default=None, init=False)
    _arrays: BinaryIO | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        self._past, fault = self._load(self.folder)
        if fault:
            _log.warning("%s; %d evaluations are kept, the rest is run again", fault, len(self._past))
        self._open(self._past)

    def _load(self, folder: Path) -> tuple[list[Entry], str]:
        """Sound entries of an earlier run, and what is wrong with the files behind them, "" for nothing."""
        path, trace = folder / ARRAYS, folder / TRACE
        data = np.fromfile(path, dtype="<f8", count=path.stat().st_size // 8) if path.exists() else np.zeros(0)
        if not trace.exists():
            return [], f"{trace} is missing" if path.exists() else ""
        entries, begin, link = [], 0, _first_link(self.identity)
        lines = trace.read_bytes().splitlines(keepends=True)
        for number, line in enumerate(lines, 1):
            try:
                body, link, arrays = _sound(line, link, data[begin:])
                entry = Entry(_evaluation(json.loads(body)), arrays)
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
                return entries, f"{trace}, line {number}, is damaged ({error})"
            entries.append(entry)
            begin += sum(array.size for array in arrays.values())
        return entries, f"{trace} is empty, and {path} is not" if begin == 0 < len(data) and not lines else ""

    def _open(self, entries: list[Entry]) -> None:
        """Cuts both files to the given entries, the trace atomically, and opens them to append."""
        assert self.folder is not None
        self.close()
        bodies = [_body(entry) for entry in entries]
        steps = zip(bodies, entries, strict=True)
        first = _first_link(self.identity)
        self._links = list(accumulate(steps, lambda link, step: _link(link, step[0], step[1].arrays), initial=first))
        part = part_of(self.folder / TRACE)
        part.write_bytes("".join(map(_line, bodies, self._links[1:])).encode())
        os.replace(part, self.folder / TRACE)
        self._trace = (self.folder / TRACE).open("ab")
        self._arrays = (self.folder / ARRAYS).open("ab")
        os.truncate(self.folder / ARRAYS, 8 * sum(array.size for entry in entries for array in entry.arrays.values()))

    def link(self, evaluations: int) -> str:
        """Hash of the first evaluations, their arrays and the cell.

        Args:
            evaluations: Number of evaluations.

        Returns:
            A hash; "" where the journal has fewer evaluations, or is kept nowhere.
        """
        return self._links[evaluations] if evaluations < len(self._links) else ""

    @property
    def replaying(self) -> bool:
        """Whether evaluations of an earlier run are left."""
        return self._position < len(self._past)

    def repeats(self, kind: str, digests: Sequence[str]) -> int:
        """Number of evaluations, one after the other, that the earlier run has made here with the same parameters.

        Args:
            kind: What is asked for.
            digests: Hashes of the parameters, in order.

        Returns:
            Their number; where the earlier run ends with them, it may have asked for more, or had no time for more.
        """
        past = self._past[self._position : self._position + len(digests)]
        made = [
            (entry.evaluation.kind, entry.evaluation.digest) == (kind, d)
            for entry, d in zip(past, digests, strict=False)
        ]
        return made.index(False) if False in made else len(made)

    def next(self, kind: str, digest: str) -> Entry | None:
        """The earlier run's evaluation that this one repeats.

        Args:
            kind: What is asked for: a loss, a gradient, a drape.
            digest: Hash of the parameters it is asked for.

        Returns:
            The earlier run's entry; None where that run had got no further.

        Raises:
            StaleJournal: The earlier run asked for something else here, so its evaluations are of another run.
        """
        if not self.replaying:
            return None
        entry = self._past[self._position]
        past = entry.evaluation
        if (past.kind, past.digest) != (kind, digest):
            raise StaleJournal(
                f"evaluation {self._position} in {self.folder} is a {past.kind} at other parameters than the "
                f"{kind} asked for now: the solver or the machine changed; begin anew without what is kept there"
            )
        if kind == "gradient" and not past.failure and "gradient" not in entry.arrays:
            raise StaleJournal(
                f"the gradients of {self.folder} were too long to be kept, and its solver saved no state "
                "of its own; begin anew without what is kept there"
            )
        self._position += 1
        return entry

    def rewind(self, evaluations: int) -> list[Entry]:
        """Keeps the first `evaluations` entries of the earlier run, without replaying them.

        For solvers that go on from their own checkpoint, or begin anew where there is none, instead of being fed from
        the journal. Drapes that follow are replayed; whatever else follows is forgotten.

        Args:
            evaluations: Number of entries that are kept.

        Returns:
            The entries kept.
        """
        done, rest = self._past[:evaluations], self._past[evaluations:]
        drapes = takewhile(lambda entry: entry.evaluation.kind in ("drape", "draw"), rest)
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
        kept = Entry(entry.evaluation, {k: v for k, v in entry.arrays.items() if k in _NEEDED or v.size <= LONGEST})
        body = _body(kept)
        self._links.append(_link(self._links[-1], body, kept.arrays))
        for array in kept.arrays.values():
            self._arrays.write(_bytes(array))
        self._arrays.flush()
        self._trace.write(_line(body, self._links[-1]).encode())
        self._trace.flush()

    def close(self) -> None:
        """Closes the files."""
        for file in (self._trace, self._arrays):
            if file is not None:
                file.close()


def forget(folder: Path) -> None:
    """Deletes what a resumed run would be fed from: evaluations and state.

    Args:
        folder: The cell's folder.
    """
    for name in (TRACE, ARRAYS, STATE):
        (folder / name).unlink(missing_ok=True)


def _sound(line: bytes, before: str, data: np.ndarray) -> tuple[str, str, dict[str, np.ndarray]]:
    """Content of a line of the trace, its hash and its arrays; raises ValueError if they do not fit."""
    if not line.endswith(b"\n"):
        raise ValueError("cut short")
    body, _, check = line.decode().rpartition(_CHECK)
    body += "}"
    arrays, begin = {}, 0
    for name, shape in json.loads(body)["arrays"].items():
        end = begin + math.prod(shape)
        if end > len(data):
            raise ValueError(f"{ARRAYS} is too short")
        arrays[name] = data[begin:end].reshape(shape)
        begin = end
    link = _link(before, body, arrays)
    if check != f'{link}"}}\n':
        raise ValueError("it is not what was written")
    return body, link, arrays


@dataclass(frozen=True)
class Checkpoint:
    """A solver's own state in `state.npz`, replaced atomically; kept nowhere where `folder` is None.

    The archive is followed by a hash of itself and of the cell's name, without which it is not opened.

    Attributes:
        folder: The cell's folder.
        identity: Name of the cell; a state that was saved under another one is not taken up.
    """

    folder: Path | None = None
    identity: str = ""

    def save(self, **arrays: np.ndarray) -> None:
        """Replaces the state."""
        if self.folder is None:
            return
        part = part_of(self.folder / STATE)
        with part.open("wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
        digest = self._digest(part, part.stat().st_size)
        with part.open("ab") as file:
            file.write(digest)
        os.replace(part, self.folder / STATE)

    def load(self) -> dict[str, np.ndarray] | None:
        """The state saved last; None where there is none, or it is damaged or of another cell, which is logged."""
        if self.folder is None or not (self.folder / STATE).exists():
            return None
        path = self.folder / STATE
        size = path.stat().st_size - _DIGEST_BYTES
        with path.open("rb") as file:
            file.seek(max(size, 0))
            written = file.read()
        if size < 0 or self._digest(path, size) != written:
            _log.warning("%s is damaged or of another cell; the cell is run again from its start", path)
            return None
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)

    def _digest(self, path: Path, size: int) -> bytes:
        """Hash of the cell's name and the first bytes of a file."""
        digest = hashlib.sha256(self.identity.encode())
        with path.open("rb") as file:
            while size > 0 and (block := file.read(min(size, 1 << 20))):
                digest.update(block)
                size -= len(block)
        return digest.digest()
