"""Answers withheld cases blind, and freezes the answers with the version of the code that gave them.

Each case is a folder in the public layout. It is read by the same loader as any data, and nothing else: no label, no
other case. Answers are kept one file a case, so that a crash loses one; a case that cannot be diagnosed is answered
`refused` with the reason, never with a guess.
"""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from cusick_bench.datasets import load
from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.files.layout import scan
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.diagnose import diagnose
from cusick_bench.diagnosis.document import answer as stated
from cusick_bench.diagnosis.document.build import answer
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.options import Options
from cusick_bench.files.digest import file_digest
from cusick_bench.files.first_names import first_names
from cusick_bench.files.hidden import is_hidden
from cusick_bench.runner.environment import version_text
from cusick_bench.runner.processes import process_pool
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.errors import CusickError
from cusick_bench.sim.setup import Simulators
from cusick_bench.withheld.answers.parts import PARTS, answer_numerics, case_digest, case_part, require_unchanged
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import Answer, AnswersDocument, LeaveOut, read_answer
from cusick_bench.withheld.format.checked_json import read_object
from cusick_bench.withheld.format.seal import files_beside, require_published_files, seals_beside

_DIGITS = 6
_SIMULATORS_KEPT = 20


def case_folders(cases: Path) -> list[Path]:
    """Finds the cases of a suite.

    Args:
        cases: Folder of the cases.

    Returns:
        The folder of each case, by name; hidden folders, those that archives and disks add (`__MACOSX`, `@eaDir`) and
        those of partial results are none.

    Raises:
        WithheldError: None there.
    """
    folders = [path for path in cases.iterdir() if path.is_dir()] if cases.is_dir() else []
    found = sorted(path for path in folders if not is_hidden(path.name) and path.suffix != PARTS)
    if not found:
        raise WithheldError(f"no case folders in {cases}; give the folder that holds the cases' folders")
    return found


def case_captures(folder: Path) -> Captures:
    """Reads the silhouettes of a case, which are a suite's own and used however odd an effect has made them.

    Args:
        folder: Folder of the case, in the public layout.

    Returns:
        Silhouettes of its fabric.

    Raises:
        WithheldError: A case of several fabrics; an answer is about one.
    """
    dataset = load(folder)  # not by name: a case may be called as a registered data set is
    if len(dataset.cloths) != 1:
        raise WithheldError(
            f"a case must hold one fabric, got {len(dataset.cloths)}: {first_names(dataset.cloths)}; give each its own "
            "folder"
        )
    return read_captures(dataset, dataset.cloths[0], force=True)


def answer_suite(
    cases: Path,
    out: Path,
    atlas: Path,
    options: Options,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> AnswersDocument:
    """Answers every case, or resumes an interrupted run.

    Args:
        cases: Folder of the cases.
        out: File for the answers; single answers lie beside it until all are there, and after. A folder of its own
            among the cases is none of them.
        atlas: Fitted atlas.
        options: How to diagnose.
        workers: Number of processes.
        step: Called with the name of every answered case.

    Returns:
        The document that was written.

    Raises:
        WithheldError: No cases, or `out` within one of them.
        DiagnosisError: An atlas that cannot be used.
    """
    place, folders = out.resolve(), case_folders(cases)
    for own in [folder for folder in folders if place.is_relative_to(folder.resolve())]:
        if _is_case(own):
            raise WithheldError(f"{out} lies within the case {own.name}; give a file outside of the cases")
        folders.remove(own)
    if not folders:
        raise WithheldError(
            f"no case folders in {cases} but that of {out}; give the folder that holds the cases' folders"
        )
    asked = dict.fromkeys(folders, options)
    return answer_each(asked, out, atlas, workers=workers, step=step)


def _is_case(folder: Path) -> bool:
    try:
        scan(folder)
    except DataNotFound:
        return False
    return True


def answer_each(
    asked: Mapping[Path, Options],
    out: Path,
    atlas: Path,
    *,
    leave_out: LeaveOut | None = None,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> AnswersDocument:
    """Answers cases, each in its own way, or resumes an interrupted run.

    Args:
        asked: How to diagnose, by the case's folder.
        out: File for the answers; single answers lie beside it until all are there, and after.
        atlas: Fitted atlas.
        leave_out: Given where every case is answered without its own effect.
        workers: Number of processes.
        step: Called with the name of every answered case.

    Returns:
        The document that was written.

    Raises:
        WithheldError: Seals beside the cases that cannot be read, or a case with other files than the sealed ones.
        DiagnosisError: An atlas that cannot be used.
    """
    seals, files, atlas_sha256 = _seals_of(asked), _files_of(asked), file_digest(atlas)
    parts = {
        folder: case_part(out, folder.name, files[folder.name], atlas, options) for folder, options in asked.items()
    }
    todo: list[_Task] = []
    for folder, part in parts.items():
        if part.exists():
            step(folder.name)
        else:
            todo.append(_Task(folder, asked[folder], part, files[folder.name], atlas_sha256))
    _answer_tasks(todo, atlas, workers, step)
    answers = {folder.name: read_answer(read_object(part), str(part)) for folder, part in parts.items()}
    more: dict[str, Any] = {} if leave_out is None else {"leave_out": leave_out}
    more |= {"seals": seals} if seals else {}
    document = AnswersDocument(
        code_version=version_text(answer_numerics()),
        atlas_sha256=atlas_sha256,
        files=files,
        answers=answers,
        **more,
    )
    write_atomically(out, json.dumps(document.content(), indent=1).encode())
    return document


def answer_case(folder: Path, atlas: Path, options: Options, simulators: Simulators | None = None) -> Answer:
    """Answers one case; the answer is `refused`, with the reason, where the case cannot be used.

    Args:
        folder: Folder of the case, in the public layout.
        atlas: Fitted atlas.
        options: How to diagnose.
        simulators: Simulators that are reused from case to case.

    Returns:
        The answer.

    Raises:
        DiagnosisError: An atlas that cannot be used, which says nothing of the case.
    """
    emulator, calibration = load_atlas(atlas)
    try:
        diagnosis = diagnose(case_captures(folder), emulator, calibration, options, simulators=simulators)
        found = answer(diagnosis).content()
    except CusickError as error:
        found = _refused(str(error)).content()
    if options.without:
        found["without"] = list(options.without)
    return read_answer(_rounded(found), folder.name)


def _seals_of(folders: Collection[Path]) -> dict[str, str]:
    """The seal of every case that has one; nothing but the document of the answers depends on them."""
    beside = {parent: seals_beside(parent) for parent in {folder.parent for folder in folders}}
    return {one.name: beside[one.parent][one.name] for one in folders if one.name in beside[one.parent]}


def _files_of(folders: Collection[Path]) -> dict[str, str]:
    """SHA-256 of what every case is read from.

    Raises:
        WithheldError: Another one than the case was published with.
    """
    found = {folder: case_digest(folder) for folder in folders}
    for parent in {folder.parent for folder in folders}:
        own = {folder.name: digest for folder, digest in found.items() if folder.parent == parent}
        require_published_files(own, files_beside(parent), str(parent))
    return {folder.name: digest for folder, digest in found.items()}


def _refused(reason: str) -> stated.Answer:
    """The answer to a case that cannot be diagnosed; it has the keys of any answer, and says nothing under them."""
    return stated.Answer(verdict="refused", where=stated.Location(why_not=reason), refused=reason).complete()


@dataclass(frozen=True)
class _Task:
    """A case to answer, how, the file for the answer, and the hashes of what that is named by."""

    folder: Path
    options: Options
    part: Path
    files: str
    atlas_sha256: str


def _answer_tasks(todo: Sequence[_Task], atlas: Path, workers: int, step: Callable[[str], None]) -> None:
    if workers <= 1:
        simulators = Simulators(most=_SIMULATORS_KEPT)
        for task in todo:
            _answer_and_write(task, atlas, simulators)
            step(task.folder.name)
        return
    with process_pool(workers) as pool:
        futures = {pool.submit(_answer_in_worker, task, atlas): task for task in todo}
        for future in as_completed(futures):
            future.result()
            step(futures[future].folder.name)


@lru_cache(maxsize=1)
def _simulators_of_worker() -> Simulators:
    """The simulators that a worker process keeps from case to case; they change nothing but the time."""
    return Simulators(most=_SIMULATORS_KEPT)


def _answer_in_worker(task: _Task, atlas: Path) -> None:
    _answer_and_write(task, atlas, _simulators_of_worker())


def _answer_and_write(task: _Task, atlas: Path, simulators: Simulators) -> None:
    found = answer_case(task.folder, atlas, task.options, simulators)
    require_unchanged(task.folder, task.files, atlas, task.atlas_sha256)
    task.part.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(task.part, json.dumps(found.content()).encode())


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return round(value, _DIGITS) if isinstance(value, float) else value
