"""From *reported* to *verified*: every finished cell of a run is repeated and scored again.

A cell is verified if its record is the one that its folder is named after and that its solver and settings make, its
samples are those of the split that it names, the data have the same hash, the stored parameters drape to the stored
shape and picture, and the metrics and the stated stiffness are the same, each within a stated tolerance
(`resimulate`). This detects parameters, pictures, metrics or stiffnesses that were changed afterwards. Costs, which
cannot be made again, and the trace have to fit the hashes of the cell's marker.
The outcome is kept in `verified.json` of the results folder, with hashes of the files for which it is valid.
"""

import json
import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

from cusick_bench import metrics
from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.splits import PROTOCOLS
from cusick_bench.files.folder_lock import locked
from cusick_bench.leaderboard.cells.loading import Skipped
from cusick_bench.leaderboard.learning_curve import learning_splits, samples_of_split
from cusick_bench.leaderboard.verification.comparison import REDRAWN, Check, equal, metric_checks, stiffness_checks
from cusick_bench.leaderboard.verification.resimulate import (
    read_record,
    repeat,
    rescore,
)
from cusick_bench.runner import Cell, record_key
from cusick_bench.runner.environment import code_state, version_text
from cusick_bench.runner.errors import RunnerError
from cusick_bench.runner.labels import numerics_text
from cusick_bench.runner.numerics import cell_numerics
from cusick_bench.runner.samples import seen_of_samples
from cusick_bench.runner.store import (
    CELL_FILE,
    PREDICTION_FILE,
    RESULT_FILE,
    Store,
    file_digests,
    read_json,
    write_json,
)
from cusick_bench.sim.errors import failure_text, raise_stop
from cusick_bench.sim.setup import Simulators
from cusick_bench.solvers.registry import make_solver

_log = logging.getLogger(__name__)

VERIFIED = "verified.json"
_MOST_BYTES = 1 << 30  # of its entries, of 6 kB a cell
_FILES = (CELL_FILE, RESULT_FILE, PREDICTION_FILE)


@dataclass(frozen=True)
class Verification:
    """Verification of one cell.

    Attributes:
        key: Its folder's name.
        solver: Solver.
        cloth: Cloth.
        seed: Seed.
        status: "verified", "rescored" (metrics hold, but nothing could be simulated again), "differs" or "unreadable".
        checks: What was compared.
        notes: Remarks for readers.
        files: SHA-256 of the files that were looked at, by name; empty where the cell's record cannot be believed.
    """

    key: str
    solver: str
    cloth: str
    seed: int
    status: str
    checks: tuple[Check, ...]
    notes: tuple[str, ...]
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def broken(self) -> list[Check]:
        """Checks that failed, the worst first."""
        return sorted((c for c in self.checks if not c.holds), key=lambda c: -c.difference / (c.tolerance or 1e-12))

    def record(self) -> dict[str, Any]:
        """The verification, flat, for JSON."""
        return {
            **{name: getattr(self, name) for name in ("key", "solver", "cloth", "seed", "status")},
            "broken": [check.name for check in self.broken],
            "checks": [
                {"name": c.name, "difference": c.difference, "tolerance": c.tolerance, "holds": c.holds}
                for c in self.checks
            ],
            "notes": list(self.notes),
        }


def verify_cell(
    folder: Path,
    dataset: DrapeDataset,
    *,
    redrawn: int = REDRAWN,
    seed: int = 0,
    simulators: Simulators | None = None,
) -> Verification:
    """Does one finished cell again.

    Args:
        folder: The cell's.
        dataset: The data that it was run on.
        redrawn: Draws of a posterior to drape again.
        seed: Seed of their choice.
        simulators: Simulators that are reused from cell to cell; by default new ones.

    Returns:
        What became of the cell; whatever is wrong with it, or with its solver, is told there.
    """
    record: dict[str, Any] = {}
    try:
        files = file_digests(folder, _FILES)  # before they are read: what is changed from now on is not verified
        record = read_record(folder)
        return replace(_verified(folder, record, dataset, redrawn, seed, simulators), files=files)
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # a solver or an effect of another package may raise anything
        raise_stop(error)
        seed_recorded = record.get("seed")
        identity = (str(record.get("solver", "?")), str(record.get("cloth", "?")))
        identity += (seed_recorded if isinstance(seed_recorded, int) else -1,)
        return Verification(folder.name, *identity, "unreadable", (), (failure_text(error),))


def unreadable(cell: Skipped) -> Verification:
    """A cell whose record cannot be believed.

    Args:
        cell: A damaged one.

    Returns:
        The cell, unreadable, and why.
    """
    seed = -1 if cell.seed is None else cell.seed
    return Verification(cell.folder.name, cell.solver or "?", cell.cloth or "?", seed, "unreadable", (), (cell.reason,))


def keep(run: Path, verifications: list[Verification]) -> None:
    """Writes what was found to the run's `verified.json`, beside what was found of other cells before.

    Args:
        run: Results folder.
        verifications: From `verify_cell`.
    """
    path = run / VERIFIED
    found = {
        verification.key: verification.record()
        | {
            "files": dict(verification.files),
            "code": code_state(),
            "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        }
        for verification in verifications
    }
    with locked(run):  # two commands may verify solvers of one run
        write_json(path, _kept(path) | found)


def _kept(path: Path) -> dict[str, Any]:
    """Entries of an earlier verification; none, with a log entry, if the file is damaged."""
    try:
        return read_json(path, most_bytes=_MOST_BYTES) if path.exists() else {}
    except RunnerError as error:
        _log.warning("%s; cells are to be verified again", error)
        return {}


def verified_keys(run: Path) -> set[str]:
    """Cells of a run that have been verified and whose files are still the same.

    Args:
        run: Results folder.

    Returns:
        Names of cells.
    """
    try:
        known = read_json(run / VERIFIED, most_bytes=_MOST_BYTES)
    except (OSError, RunnerError):
        return set()
    verified = {
        key: found for key, found in known.items() if isinstance(found, dict) and found.get("status") == "verified"
    }
    return {key for key, found in verified.items() if found.get("files") == file_digests(run / "cells" / key, _FILES)}


def _verified(
    folder: Path,
    record: dict[str, Any],
    dataset: DrapeDataset,
    redrawn: int,
    seed: int,
    simulators: Simulators | None,
) -> Verification:
    result, cell = read_json(folder / RESULT_FILE), Cell.from_record(record)
    checks, notes = list(_identity_checks(folder, cell, record, result, dataset)), []
    identity = (folder.name, cell.label, cell.cloth, cell.seed)
    if result.get("status") != "done":
        return Verification(*identity, "unreadable", (), ("the cell has failed; it claims nothing",))
    if dataset.content_hash == cell.dataset_hash:  # else rows of its index are other drapes, or none
        notes += _other_numerics(cell, record, dataset)
    if all(check.holds for check in checks):
        split = list(_split_checks(cell, dataset))
        checks += split
        if not split:
            notes.append(f"{cell.protocol} is no split of this program: the record alone says what was unseen")
    if not all(check.holds for check in checks):
        return Verification(*identity, "differs", tuple(checks), tuple(notes))
    kind = str(record["kind"])
    repetition = repeat(folder, cell, kind, dataset, redrawn=redrawn, seed=seed, simulators=simulators)
    again = rescore(repetition, cell, dataset)
    lost = sorted(set(result["metrics"]) - set(again))
    notes += [*repetition.notes, *([f"no longer measured: {', '.join(lost)}"] if lost else [])]
    stored, same_code = result["metrics"], dict(cell.numerics).get("metrics") == metrics.NUMERICS_VERSION
    checks += [*repetition.checks, *metric_checks(stored, again, same_draws=repetition.same_draws, all_known=same_code)]
    fault = Store(folder.parent.parent).fault(folder.name)
    checks.append(Check("files", inf if fault else 0.0, 0.0, fault))
    checks += stiffness_checks(result, repetition.stiffness)
    held = all(check.holds for check in checks)
    status = "differs" if not held else "verified" if repetition.simulated else "rescored"
    return Verification(*identity, status, tuple(checks), tuple(notes))


def _other_numerics(cell: Cell, record: dict[str, Any], dataset: DrapeDataset) -> list[str]:
    """A note where the code at hand has other numerics than the code that ran the cell."""
    solver, settings = make_solver(cell.solver), cell.settings
    seen = seen_of_samples(dataset, cell.train, cell.test)
    now = cell_numerics(solver, settings.drape, settings.causes, space=settings.space, **seen)
    if dict(cell.numerics) == now:
        return []
    then = numerics_text(dict(cell.numerics)) or str(record.get("code_version", "unknown"))
    return [f"the cell was run by code {then}, verified by {version_text(now)}"]


def _identity_checks(
    folder: Path, cell: Cell, record: dict[str, Any], result: dict[str, Any], dataset: DrapeDataset
) -> Iterator[Check]:
    """Whether the cell fits its folder's name, and the data fit its record."""
    yield equal("record", record_key(record), folder.name)
    made = cell.record() | {"solver_options": record.get("solver_options")}
    unlike = [name for name, value in made.items() if name in record and _text(record[name]) != _text(value)]
    yield equal("record of solver and settings", f"{', '.join(unlike)} changed" if unlike else "", "")
    changed = [name for name, value in record.items() if result.get(name) != value]
    yield equal("result's record", f"{', '.join(changed)} changed" if changed else "", "")
    yield equal("data", dataset.content_hash, str(record.get("dataset_hash")))


def _text(value: object) -> str:
    return json.dumps(value, sort_keys=True, default=str)  # as `record_key` does


def _split_checks(cell: Cell, dataset: DrapeDataset) -> Iterator[Check]:
    """Whether the cell's samples are those of the split that it names; none where the split is of the user's making."""
    learned = samples_of_split(cell.protocol)
    if cell.protocol in PROTOCOLS:
        splits = dataset.split(cell.protocol, [cell.cloth])
    elif learned is not None:
        splits = learning_splits(dataset, [cell.cloth], [learned], len(cell.test))[learned]
    else:
        return
    known = any((cell.train, cell.test) == (split.train, split.test) for split in splits)
    yield equal("split", cell.protocol if known else f"other samples than those of {cell.protocol}", cell.protocol)
