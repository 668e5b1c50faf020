"""Diagnoses of all fabrics, with the effects that they share; finished ones are reused if nothing has changed."""

from collections.abc import Callable, Sequence
from pathlib import Path

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.errors import DataError
from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.data_set import data_set_diagnosis
from cusick_bench.diagnosis.document.laboratory import write_laboratory
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import Captures, read_captures
from cusick_bench.diagnosis.options import LEAST_SAMPLES, SHIPPED
from cusick_bench.diagnosis.options import Options as DiagnosisOptions
from cusick_bench.files.plain_names import plain_names
from cusick_bench.identify.options import Options
from cusick_bench.identify.workspace import Workspace, fingerprint, keep, kept
from cusick_bench.report.diagnosis.page import write_diagnosis_page
from cusick_bench.runner.numerics import diagnosis_numerics

Progress = Callable[[str, float], None]


def fabric_folder(workspace: Workspace, dataset: DrapeDataset, fabric: str) -> Path:
    """Folder of a fabric's diagnosis.

    Args:
        workspace: The workspace.
        dataset: The data, whose other fabrics have folders of their own.
        fabric: Name of the fabric.

    Returns:
        Its path, whether it exists or not.
    """
    return workspace.diagnosis / plain_names(dataset.cloths)[fabric]


def diagnose_fabrics(
    data: str,
    dataset: DrapeDataset,
    cloths: Sequence[str],
    workspace: Workspace,
    options: Options,
    progress: Progress = lambda what, share: None,
    atlas: Path = SHIPPED,
) -> tuple[dict[str, DiagnosisDocument], dict[str, str]]:
    """Diagnoses fabrics of several samples; those whose documents are there already, made of the same, are read.

    Args:
        data: Name or folder of the data set.
        dataset: The data themselves.
        cloths: Cloths to diagnose.
        workspace: Where documents and pages lie.
        options: How to diagnose.
        progress: Called with what is being done and the share that is done.
        atlas: The atlas.

    Returns:
        Documents by cloth, and for each cloth without one the reason.
    """
    captures, missing = _captures(dataset, cloths, options)
    if not captures:
        return {}, missing
    asked = DiagnosisOptions(options.samples, seed=options.seed)
    key = fingerprint(
        {
            "data": dataset.content_hash,
            "fabrics": list(captures),
            "samples": options.samples,
            "seed": options.seed,
            "force": options.force,
            "numerics": diagnosis_numerics(diagnosis=NUMERICS_VERSION),
        },
        [atlas],
    )
    documents = {}
    folders = {name: fabric_folder(workspace, dataset, name) for name in captures}
    if kept(workspace.diagnosis_record, key) is not None:
        documents = {name: one for name, folder in folders.items() if (one := _earlier(folder)) is not None}
    else:
        for folder in folders.values():
            (folder / "diagnosis.json").unlink(missing_ok=True)
        workspace.diagnosis.mkdir(parents=True, exist_ok=True)
        keep(workspace.diagnosis_record, key, {"fabrics": list(captures)})
    waiting = [name for name in captures if name not in documents]
    if not waiting:
        return documents, missing
    steps = len(waiting) + 1
    diagnosis = data_set_diagnosis(
        captures, *load_atlas(atlas), asked, lambda what, share: progress(what, share / steps)
    )
    write_laboratory(diagnosis.shared, workspace.diagnosis)
    for number, name in enumerate(waiting, start=1):

        def tell(what: str, share: float, name: str = name, number: int = number) -> None:
            progress(f"{name}: {what}", (number + share) / steps)

        command = asked.command(data, diagnosis.together(name), atlas, force=options.force)
        documents[name] = diagnosis.document(name, command=command, progress=tell)
        _write(documents[name], folders[name])
    return {name: documents[name] for name in captures}, missing


def _captures(
    dataset: DrapeDataset, cloths: Sequence[str], options: Options
) -> tuple[dict[str, Captures], dict[str, str]]:
    """Silhouettes of the fabrics that can be diagnosed, and why the others cannot."""
    captures: dict[str, Captures] = {}
    missing: dict[str, str] = {}
    for cloth in cloths:
        cut = len(set(dataset.select(cloth=cloth).table["sample"]))
        if cut < LEAST_SAMPLES:
            missing[cloth] = _too_few(cut, cut)
            continue
        try:
            own = read_captures(dataset, cloth, force=options.force)
        except (DataError, DiagnosisError) as error:
            missing[cloth] = str(error)
            continue
        usable = len(set(own.sample))
        if usable < LEAST_SAMPLES:
            missing[cloth] = _too_few(usable, cut)
        else:
            captures[cloth] = own
    return captures, missing


def _too_few(usable: int, cut: int) -> str:
    """Why so few samples are not diagnosed, of so many that were cut."""
    there = "there is one sample" if usable == 1 else f"there are {usable} samples"
    if usable < cut:
        there += f" of {cut} whose pictures can be used (`cusick-bench data audit` says what is wrong with the others)"
    return (
        f"{there}; what the simulator leaves out can only be told from how several samples scatter, of which at least "
        f"{LEAST_SAMPLES} are needed"
    )


def _earlier(folder: Path) -> DiagnosisDocument | None:
    if not (folder / "diagnosis.html").is_file():
        return None
    try:
        return DiagnosisDocument.read(folder / "diagnosis.json")
    except DiagnosisError:
        return None


def _write(one: DiagnosisDocument, folder: Path) -> None:
    """Page first: where the document is there, all is."""
    folder.mkdir(parents=True, exist_ok=True)
    write_diagnosis_page(one, folder / "diagnosis.html")
    one.write(folder / "diagnosis.json")
