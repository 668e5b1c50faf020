"""Answers withheld cases blind, and freezes the answers with the version of the code that gave them.

Each case is a folder in the public layout. It is read by the same loader as any data, and nothing else: no label, no
other case. Answers are kept one file a case, so that a crash loses one; a case that cannot be diagnosed is answered
`unknown` with the reason, never with a guess.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from cusick_bench.datasets import load
from cusick_bench.diagnosis.captures import read_captures
from cusick_bench.diagnosis.diagnose import Options, diagnose
from cusick_bench.diagnosis.document import answer
from cusick_bench.diagnosis.evidence import UNKNOWN
from cusick_bench.diagnosis.store import load as load_atlas
from cusick_bench.runner.environment import code_version
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.errors import CusickError
from cusick_bench.sim.setup import Simulators
from cusick_bench.withheld.errors import WithheldError

_DIGITS = 6


def case_folders(cases: Path) -> list[Path]:
    """The cases of a suite, by name.

    Raises:
        WithheldError: None there.
    """
    found = sorted(p for p in cases.iterdir() if p.is_dir() and not p.name.startswith(".")) if cases.is_dir() else []
    if not found:
        raise WithheldError(f"no case folders in {cases}; give the folder that holds the cases' folders")
    return found


def answer_suite(
    cases: Path,
    out: Path,
    atlas: Path,
    options: Options,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> dict[str, Any]:
    """Answers every case, or goes on with a suite that was begun.

    Args:
        cases: Folder of the cases.
        out: File for the answers; single answers lie beside it until all are there, and after.
        atlas: Fitted atlas.
        options: How to diagnose.
        workers: Processes.
        step: Told of every answered case.

    Returns:
        The document that was written.

    Raises:
        WithheldError: No cases.
    """
    folders = case_folders(cases)
    kept = out.with_name(out.name + ".parts") / _fingerprint(atlas, options)
    kept.mkdir(parents=True, exist_ok=True)
    todo = [folder for folder in folders if not (kept / f"{folder.name}.json").exists()]
    for folder in folders:
        if folder not in todo:
            step(folder.name)
    _each(todo, kept, atlas, options, workers, step)
    found = {folder.name: json.loads((kept / f"{folder.name}.json").read_text()) for folder in folders}
    content = {"code_version": code_version(), "atlas_sha256": _digest(atlas), "answers": found}
    write_atomically(out, json.dumps(content, indent=1).encode())
    return content


def answer_case(folder: Path, atlas: Path, options: Options, simulators: Simulators | None = None) -> dict[str, Any]:
    """The answer to one case; `unknown`, with the reason, where the case cannot be used.

    Args:
        folder: In the public layout.
        atlas: Fitted atlas.
        options: How to diagnose.
        simulators: Kept from case to case.
    """
    try:
        emulator, calibration = load_atlas(atlas)
        dataset = load(str(folder))
        captures = read_captures(dataset, dataset.cloths[0])
        found = answer(diagnose(captures, emulator, calibration, options, simulators=simulators))
    except CusickError as error:
        return _refused(str(error))
    if options.without:
        found["without"] = list(options.without)
    return _rounded(found)


def _refused(reason: str) -> dict[str, Any]:
    cause = {"effect": UNKNOWN, "class": "", "probability": 1.0, "parameters": {}}
    return {
        "verdict": UNKNOWN, "gap": {"base": None, "floor": None, "p": None}, "causes": [cause], "set90": [UNKNOWN],
        "where": {"localisable": False, "why_not": reason}, "closure": {}, "next": [], "refused": reason,
    }  # fmt: skip


def _each(
    todo: Sequence[Path], kept: Path, atlas: Path, options: Options, workers: int, step: Callable[[str], None]
) -> None:
    if workers <= 1:
        simulators = Simulators(most=20)
        for folder in todo:
            _answer_and_write(folder, kept, atlas, options, simulators)
            step(folder.name)
        return
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # the processes share the cores
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(_answer_and_write, folder, kept, atlas, options): folder for folder in todo}
        for future in as_completed(futures):
            future.result()
            step(futures[future].name)


_SIMULATORS = Simulators(most=20)


def _answer_and_write(
    folder: Path, kept: Path, atlas: Path, options: Options, simulators: Simulators | None = None
) -> None:
    found = answer_case(folder, atlas, options, simulators or _SIMULATORS)
    write_atomically(kept / f"{folder.name}.json", json.dumps(found).encode())


def _fingerprint(atlas: Path, options: Options) -> str:
    """Answers of other code, another atlas or other options are not taken over."""
    return hashlib.sha256(f"{code_version()} {_digest(atlas)} {options}".encode()).hexdigest()[:16]


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return round(value, _DIGITS) if np.isfinite(value) else None
    return value
