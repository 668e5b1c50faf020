"""What a perfect diagnosis would close: the true cause with its true parameters, in the diagnosis' own simulator.

The truth follows other laws than the simulator that answers, so even the right cause leaves a gap; an answer's closure
is judged against this one. It needs the labels, so it is made after the answers.
"""

import json
from collections.abc import Callable, Mapping
from concurrent.futures import as_completed
from math import isfinite
from pathlib import Path
from typing import Any

from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.evidence import Candidate
from cusick_bench.diagnosis.inference.hypotheses import hypotheses
from cusick_bench.diagnosis.simulation.closure import Draping, closure_by
from cusick_bench.runner.processes import process_pool
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.errors import CusickError
from cusick_bench.withheld.answers.blind import case_captures
from cusick_bench.withheld.format.checked_json import listed, mapping
from cusick_bench.withheld.format.label import DETECTABLE, PAIR, SINGLE, read_labels


def oracle_closures(
    cases: Path,
    labels: Mapping[str, Any],
    out: Path,
    atlas: Path,
    draping: Draping,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> dict[str, float | None]:
    """Closure by the true cause of every case that has one, the strongest first, or goes on with a file that was begun.

    Args:
        cases: Folder of the cases.
        labels: Content of labels.json.
        out: File for the closures by case; null where there is no gap, or no such effect in the atlas.
        atlas: Fitted atlas.
        draping: Samples and seed of the simulations.
        workers: Processes.
        step: Told of every case.
    """
    found: dict[str, float | None] = json.loads(out.read_text()) if out.exists() else {}
    known = read_labels(labels, "labels")
    todo = [
        name
        for name, label in known.items()
        if name not in found and label.kind in (SINGLE, PAIR) and (cases / name).is_dir()
    ]
    todo.sort(key=lambda name: (known[name].unit != DETECTABLE, -known[name].multiple))  # the strongest count most
    with process_pool(workers) as pool:
        futures = {pool.submit(oracle_closure, cases / name, labels[name], atlas, draping): name for name in todo}
        for future in as_completed(futures):
            found[futures[future]] = future.result()
            write_atomically(out, json.dumps(found, indent=1, sort_keys=True).encode())
            step(futures[future])
    return found


def oracle_closure(folder: Path, label: Mapping[str, Any], atlas: Path, draping: Draping) -> float | None:
    """Closure by the true cause of one case; None where there is no gap, or no such effect in the atlas."""
    emulator, _ = load_atlas(atlas)
    known = {one.name: one for one in reversed(hypotheses(emulator))}
    names = label["effect"] if isinstance(label["effect"], list) else [label["effect"]]
    values = label["parameters"] if isinstance(label["parameters"], list) else [label["parameters"]]
    if any(name not in known for name in names):
        return None
    causes = []
    for name, value in zip(names, listed(values, len(names), folder.name), strict=True):
        hypothesis = known[name]
        given = {key: float(number) for key, number in mapping(value, folder.name).items()}
        full = {key: float(number) for key, number in hypothesis.effect.complete(given).items()}
        causes.append(Candidate(hypothesis, full, 0.0, 0.0, 0.0))
    try:
        found = closure_by(case_captures(folder), emulator, tuple(causes), draping)
    except CusickError:
        return None
    return found.closure if found is not None and isfinite(found.closure) else None
