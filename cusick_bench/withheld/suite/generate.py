"""Writes a withheld suite: cases in the public layout here, sealed labels there.

Labels and the commitment to them are written first and every case appears whole or not at all, so a generation that
was stopped goes on where it was. The commitment binds the cases' files as well once all are there. Everything follows
from the seed.
"""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from pydantic.dataclasses import dataclass

from cusick_bench.files.digest import folder_digest
from cusick_bench.files.folder_lock import locked
from cusick_bench.runner.labels import numerics_text
from cusick_bench.runner.numerics import LAWS, drape_numerics
from cusick_bench.runner.processes import one_thread, process_pool
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.withheld import NUMERICS_VERSION
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.checked_json import read_object, validated
from cusick_bench.withheld.format.seal import (
    COMMITMENT,
    FILES,
    published_files,
    published_seals,
    require_published_files,
    salt_of,
    sealed,
)
from cusick_bench.withheld.suite.design import MULTIPLES, Kind, Plan, plan_suite
from cusick_bench.withheld.suite.detectable import DetectableSeverities
from cusick_bench.withheld.suite.labels import label_of
from cusick_bench.withheld.world.photograph import LABORATORY, jpeg
from cusick_bench.withheld.world.registry import DEFAULT
from cusick_bench.withheld.world.true_case import CAPTURES, SAMPLES, TrueCase

LABELS, SUITE = "labels.json", "suite.json"
_DENSITY_ERROR = 0.01  # of the density in a case's table
_WRITTEN = 946_684_800  # [s] 2000-01-01, time of all files of a case


@dataclass(frozen=True)
class Suite:
    """Description of a suite; the form of `suite.json`.

    Attributes:
        seed: Seed of all random choices. Whoever knows it knows every label: keep it with the labels, take a long one.
        counts: Cases of each kind.
        vertices: Mesh size of the truth; that of its world if None.
        samples: Samples of each case.
        detectable: Severities at which effects are detected in most cases; typical severities if None.
        world: Name of the world that the cases lie in.
        multiples: Severities of single effects, in multiples of what is typical or detectable.
        numerics: Versions of the code that makes the cases, by part; None in a file of before these were kept. The same
            suite may be made by other code, so they do not count where suites are compared.
    """

    seed: int
    counts: dict[Kind, int]
    vertices: int | None = None
    samples: int = SAMPLES
    detectable: DetectableSeverities | None = None
    world: str = DEFAULT
    multiples: tuple[float, ...] = MULTIPLES
    numerics: dict[str, int] | None = field(default=None, compare=False, repr=False)

    def plans(self) -> list[Plan]:
        """Plans the cases of the suite.

        Returns:
            The cases.
        """
        return plan_suite(self.seed, self.counts, self.detectable, self.world, self.multiples)


_SUITE = TypeAdapter(Suite)


def suite_numerics(world: str = DEFAULT) -> dict[str, int]:
    """Versions of what decides the pictures of a suite's cases.

    Args:
        world: Name of their world; `published` has the law of that name, whose version 1 is omitted.

    Returns:
        Version of each part, by name.
    """
    versions = drape_numerics("paper") | {"withheld": NUMERICS_VERSION}
    if LAWS.get(world, 1) > 1:
        versions[f"law {world}"] = LAWS[world]
    return dict(sorted(versions.items()))


def read_suite(path: Path) -> Suite:
    """Reads the suite.json that `generate` left with the labels.

    Args:
        path: The file.

    Returns:
        The suite.

    Raises:
        WithheldError: There is none, as with cases that somebody else made, or it is not one.
    """
    found = read_object(path, "`withheld generate` leaves it beside labels.json, and only for its own cases")
    return validated(_SUITE, found, f"{path} is no description of a suite by `withheld generate`")


def generate(
    suite: Suite, out: Path, labels: Path, *, workers: int = 1, step: Callable[[str], None] = lambda case: None
) -> list[Path]:
    """Writes a suite.

    Args:
        suite: Description of the suite.
        out: Folder of the cases, with the commitment to their labels; nothing else is written there.
        labels: Folder of the labels, outside of `out`.
        workers: Number of processes.
        step: Called with each case's name when it is there, or was.

    Returns:
        Folders of the cases, in order.

    Raises:
        WithheldError: Folders within each other, or that hold another suite or cases by other code, or a case that
            cannot be made.
        FolderInUse: Another process is making cases there: both would write into one case.
    """
    _check_folders(out, labels)
    out.mkdir(parents=True, exist_ok=True)
    with locked(out, wait=False):
        return _generate(suite, out, labels, workers, step)


def _generate(suite: Suite, out: Path, labels: Path, workers: int, step: Callable[[str], None]) -> list[Path]:
    plans = suite.plans()
    missing = [plan for plan in plans if not (out / plan.case).is_dir()]
    if missing:
        _require_same_code(labels / SUITE)
    _commit(suite, plans, out, labels)
    for plan in plans:
        if plan not in missing:
            step(plan.case)
    if workers == 1:
        with one_thread():
            for plan in missing:
                step(write_case(suite, plan, out))
    elif missing:
        _on_processes(suite, missing, out, workers, step)
    _seal_files(plans, out)
    return [out / plan.case for plan in plans]


def _check_folders(out: Path, labels: Path) -> None:
    cases, secret = out.resolve(), labels.resolve()
    if secret.is_relative_to(cases) or cases.is_relative_to(secret):
        raise WithheldError(
            f"labels and cases must lie in different folders, got {labels} and {out}; put the labels where whoever "
            "answers cannot look"
        )


def _require_same_code(path: Path) -> None:
    """Refuses to go on with a suite that other code began: its cases would be of two versions.

    Raises:
        WithheldError: Other code, or nobody knows which.
    """
    if not path.exists():
        return
    suite = read_suite(path)
    begun, now = suite.numerics, suite_numerics(suite.world)
    if begun != now:
        by = "code that did not record its version" if begun is None else f"code {numerics_text(begun)}"
        raise WithheldError(
            f"all cases of a suite must be made by the same code, but {path.parent} was begun by {by}, and this is "
            f"{numerics_text(now)}; finish it with the code that began it, or make it anew in empty folders"
        )


def require_own_code(suite: Suite, cases: Path) -> None:
    """Refuses to compare cases with what another code than theirs makes: their difference would be that of two codes.

    Args:
        suite: Their suite; one of before versions were kept may be of any code, and passes.
        cases: Their folder, for the message.

    Raises:
        WithheldError: They are of another code.
    """
    now = suite_numerics(suite.world)
    if suite.numerics is not None and suite.numerics != now:
        raise WithheldError(
            f"twins must be made by the code that made their cases, but {cases} was made by code "
            f"{numerics_text(suite.numerics)}, and this is {numerics_text(now)}: what differs between the two would "
            "count as shown; make the twins with that code"
        )


def _commit(suite: Suite, plans: Sequence[Plan], out: Path, labels: Path) -> None:
    """Writes labels and commitment, or checks that they are there already."""
    found = {plan.case: sealed(label_of(plan).content(), salt_of(suite.seed, plan.case)) for plan in plans}
    commitment = {
        "hash": "SHA-256 of salt + label without salt and sha256, as JSON with sorted keys and no spaces, in UTF-8",
        "cases": {case: label["sha256"] for case, label in found.items()},
    }
    documents = (
        (labels / SUITE, _SUITE.dump_python(replace(suite, numerics=suite_numerics(suite.world)), mode="json")),
        (labels / LABELS, found),
        (out / COMMITMENT, commitment),
    )
    texts = {path: json.dumps(document, indent=1) + "\n" for path, document in documents}
    same: dict[Path, Callable[[Path], bool]] = {
        labels / SUITE: lambda path: read_suite(path) == suite,
        labels / LABELS: lambda path: path.read_text() == texts[path],
        out / COMMITMENT: lambda path: published_seals(path) == commitment["cases"],
    }
    for path in texts:  # all of them, before any is written
        if path.exists() and not same[path](path):
            raise WithheldError(
                f"{path} belongs to another suite; go on with the seed and options that it was made with, or choose "
                "an empty folder"
            )
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            _write_whole(path, text.encode())


def _seal_files(plans: Sequence[Plan], out: Path) -> None:
    """Adds to the commitment which files each case consists of, or checks that they still are these.

    Raises:
        WithheldError: A case that was changed after it had been sealed.
    """
    path, found = out / COMMITMENT, {plan.case: folder_digest(out / plan.case) for plan in plans}
    if published := published_files(path):
        require_published_files(found, published, str(out))
        return
    more = {"files_hash": "SHA-256 of the list of (name, SHA-256) of a case's files, as Python prints it", FILES: found}
    _write_whole(path, (json.dumps(read_object(path) | more, indent=1) + "\n").encode())


def _write_whole(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    os.replace(part, path)


def write_case(suite: Suite, plan: Plan, out: Path) -> str:
    """Simulates a case and writes it; it appears under its name when it is complete.

    Args:
        suite: The suite that the case belongs to.
        plan: Plan of the case.
        out: Folder of the cases.

    Returns:
        Its name.

    Raises:
        WithheldError: A drape diverged.
    """
    part = out / f".{plan.case}.part"
    shutil.rmtree(part, ignore_errors=True)
    folder = part / "Fabric 1" / "silhouettes"
    folder.mkdir(parents=True)
    truth = TrueCase(
        (suite.seed, plan.number), plan.causes, suite.vertices, attempt=plan.attempt, world_name=suite.world
    )
    try:
        for picture in truth.pictures(suite.samples):
            name = f"Fabric_1_Sample_{picture.sample}_Capture_{picture.capture}.jpg"
            (folder / name).write_bytes(jpeg(picture.levels, truth.world.camera.quality))
    except DrapeDiverged as error:
        raise WithheldError(f"{plan.case}: {error}; choose another seed") from error
    (part / "fabrics.csv").write_bytes(_fabrics_table(truth).encode())
    (part / "protocol.json").write_bytes((json.dumps(_protocol(), indent=1) + "\n").encode())
    for path in (*part.rglob("*"), part):  # how long a drape took tells which laws acted
        os.utime(path, (_WRITTEN, _WRITTEN))
    os.replace(part, out / plan.case)
    return plan.case


def _fabrics_table(truth: TrueCase) -> str:
    """The nominal density, weighed with an error."""
    error = np.random.default_rng([*truth.seed, 3]).uniform(-_DENSITY_ERROR, _DENSITY_ERROR)
    density, thickness = float(truth.fabric.material.density) * (1 + error), truth.fabric.thickness
    return f"fabric,areal_density_kg_m2,thickness_m\n1,{density:.5f},{thickness:.6f}\n"


def _protocol() -> dict[str, Any]:
    """Nominal values of the suites' own laboratory, which is set up as the public release's, whatever is true."""
    turned, order = "about y: material x points to -x when face down", "captures 1, 2 face up, then 3, 4 face down"
    return replace(LABORATORY, captures=dict(CAPTURES), turn_over=turned, order=order).document()


def _write_alone(suite: Suite, plan: Plan, out: Path) -> str:
    """Writes a case on one thread, whatever the environment says: bytes then depend on nothing but the seed."""
    with one_thread():
        return write_case(suite, plan, out)


def _on_processes(suite: Suite, plans: Sequence[Plan], out: Path, workers: int, step: Callable[[str], None]) -> None:
    failures: list[str] = []
    try:
        with process_pool(min(workers, len(plans))) as pool:
            for future in as_completed([pool.submit(_write_alone, suite, plan, out) for plan in plans]):
                try:
                    step(future.result())
                except WithheldError as error:
                    failures.append(str(error))
    except BrokenProcessPool as error:
        raise WithheldError(
            "a worker was killed, probably out of memory; run the same command again with fewer --workers, it goes on"
        ) from error
    if failures:
        raise WithheldError(f"{len(failures)} of {len(plans)} cases cannot be made: {failures[0]}")
