"""Closure by a perfect diagnosis: the true cause with its true parameters, in the diagnosis' own simulator.

The true world has other laws than the simulator that answers, so even the right cause leaves a gap; the closure of an
answer is compared with this one. It needs the labels, so it is computed after the answers.
"""

import json
from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path

from pydantic import TypeAdapter

from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.diagnosis.simulation.closure import Draping, closure_by
from cusick_bench.files.digest import file_digest
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import Effect, registered
from cusick_bench.sim.errors import CusickError, SimulationError
from cusick_bench.withheld.answers.blind import case_captures
from cusick_bench.withheld.answers.parts import case_part, gather, require_labels_of, require_unchanged
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.checked_json import read_object, validated
from cusick_bench.withheld.format.fields import Number
from cusick_bench.withheld.format.label import DETECTABLE, PAIR, SINGLE, LabelDocument, truth_of

OracleClosures = dict[str, float | None]
"""Content of `oracle.json`: closure of each case by its true cause; None where there is no gap to close."""

_CLOSURES = TypeAdapter(dict[str, Number | None])


def read_oracle_closures(path: Path) -> OracleClosures:
    """Reads what `oracle_closures` wrote.

    Args:
        path: The file.

    Returns:
        The closure of each case.

    Raises:
        WithheldError: Not such a file.
    """
    return validated(_CLOSURES, read_object(path, "make it by `withheld oracle`"), str(path))


def oracle_closures(
    cases: Path,
    labels: Mapping[str, LabelDocument],
    out: Path,
    atlas: Path,
    draping: Draping,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> OracleClosures:
    """Closure by the true cause of every case that has one, the strongest first, or resumes an interrupted run.

    Args:
        cases: Folder of the cases.
        labels: Content of labels.json.
        out: File for the closures by case; null where there is no gap, or no such effect in the atlas. Single closures
            lie beside it.
        atlas: Fitted atlas.
        draping: Samples and seed of the simulations.
        workers: Number of processes.
        step: Called with the name of every case that is done.

    Returns:
        The closure of each case.

    Raises:
        WithheldError: Labels of another suite than the cases, or a label without all parameters of its effects, or
            with some out of their bounds.
    """
    files, atlas_sha256 = require_labels_of(cases, labels), file_digest(atlas)
    truth = {case: truth_of(label) for case, label in labels.items()}
    asked = [case for case, label in truth.items() if label.kind in (SINGLE, PAIR) and case in files]
    for case in asked:
        _require_parameters(case, labels[case])
    asked.sort(key=lambda case: (truth[case].unit != DETECTABLE, -truth[case].multiple))  # the strongest count most
    parts = {case: _part(out, case, files[case], labels[case], atlas, draping) for case in asked}
    return gather(
        out, parts, lambda case: (oracle_closure, cases / case, labels[case], atlas, draping),
        read=read_oracle_closures, write=_write, workers=workers, step=step,
        check=lambda case: require_unchanged(cases / case, files[case], atlas, atlas_sha256),
    )  # fmt: skip


def _require_parameters(case: str, label: LabelDocument) -> None:
    """Makes sure that a label says how its effects act: what it leaves out would be taken as typical.

    Raises:
        WithheldError: A parameter is missing or out of its bounds.
    """
    given = label.parameters_of_effects
    for place, name in enumerate(label.effects):
        known, stated = registered().get(name), given[place] if place < len(given) else {}
        if known is None:
            continue
        if lacking := [p.name for p in known.parameters if p.name not in stated]:
            raise WithheldError(
                f"the closure by the true effect needs all of its parameters, but the label of {case} lacks "
                f"{', '.join(lacking)} of {name}; write them under `parameters`"
            )
        try:
            known.complete(_own_parameters(known, stated))
        except SimulationError as error:
            raise WithheldError(
                f"the label of {case} is of nothing that can be simulated: {error}; correct it"
            ) from error


def _own_parameters(effect: Effect, stated: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect in a label, which may state more."""
    return {p.name: float(stated[p.name]) for p in effect.parameters if p.name in stated}


def _part(out: Path, case: str, files: str, label: LabelDocument, atlas: Path, draping: Draping) -> Path:
    """Path of the file with the closure of one case."""
    return case_part(out, case, files, atlas, label.unsealed(), f"samples {draping.samples}, seed {draping.seed}")


def _write(path: Path, closures: OracleClosures) -> None:
    write_atomically(path, json.dumps(closures, indent=1, sort_keys=True).encode())


def oracle_closure(folder: Path, label: LabelDocument, atlas: Path, draping: Draping) -> float | None:
    """Closure by the true cause of one case.

    Args:
        folder: Folder of the case.
        label: Its label.
        atlas: Fitted atlas.
        draping: Samples and seed of the simulations.

    Returns:
        The closure; None where there is no gap, or no such effect in the atlas.
    """
    emulator, _ = load_atlas(atlas)
    known = {one.name: one for one in reversed(hypotheses(emulator))}
    if any(name not in known for name in label.effects):
        return None
    causes = []
    for name, value in zip(label.effects, label.parameters_of_effects, strict=True):
        effect = known[name].effect
        full = {key: float(number) for key, number in effect.complete(_own_parameters(effect, value)).items()}
        causes.append(Candidate(known[name], full, 0.0, 0.0, 0.0))
    try:
        gap = closure_by(case_captures(folder), emulator, tuple(causes), draping)
    except CusickError:
        return None
    return gap.closure if gap is not None and isfinite(gap.closure) else None
