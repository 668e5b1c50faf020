"""A fabric's material from a cell of `run`, or from an `identify.json`."""

from __future__ import annotations

from pathlib import Path

from cusick_bench.export.errors import ExportError
from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.files import read_json_object
from cusick_bench.garment.cloth import density_of_cell
from cusick_bench.identify.document import UNWEIGHED, FabricIdentity, IdentifyDocument
from cusick_bench.metrics.found_stiffness import Quantity, read_stiffness
from cusick_bench.runner.labels import labelled, recorded_settings
from cusick_bench.runner.store import CELL_FILE, RESULT_FILE

_DOCUMENT = "identify.json"
_REMEDY = "repeat the `cusick-bench run` command, which runs the cell again"


def read_material(result: Path, *, fabric: str | None = None, density: float | None = None) -> FabricMaterial:
    """The stiffness and the weight that a result states of a fabric.

    Args:
        result: A cell's folder RUN/cells/KEY, or `identify.json` or the folder that it lies in.
        fabric: Name of the fabric, needed where `identify.json` has several with a stiffness.
        density: Areal density to take instead of the result's [kg/m2]. A drape tells of a cloth only the ratios of its
            stiffness to its weight, so that the stiffness is scaled as the weight is.

    Returns:
        The material.

    Raises:
        ExportError: There is no result, it has no stiffness, its weight is unknown, or no such fabric.
        CusickError: A damaged file.
    """
    document = result / _DOCUMENT if result.is_dir() else result
    if result.is_dir() and not document.exists():
        return _of_cell(result, fabric, density)
    if not document.is_file():
        raise ExportError(f"no result at {result}; give a cell RUN/cells/KEY of `run`, or an {_DOCUMENT}")
    if (document.parent / CELL_FILE).is_file():
        raise ExportError(f"{document} is a file of a cell; give the cell's folder, {document.absolute().parent}")
    return _of_document(document, fabric, density)


def _of_cell(folder: Path, fabric: str | None, density: float | None) -> FabricMaterial:
    if not (folder / CELL_FILE).is_file():
        raise ExportError(f"{folder} is neither a cell nor has it an {_DOCUMENT}; give RUN/cells/KEY or {_DOCUMENT}")
    path = folder / RESULT_FILE
    if not path.is_file():
        raise ExportError(f"{folder} has no result.json: the cell has not finished; {_REMEDY}")
    result = read_json_object(path, remedy=_REMEDY)
    cloth, solver = str(result.get("cloth", "cloth")), str(result.get("solver", "unknown"))
    if result.get("status") == "failed":
        raise ExportError(f"{folder}: {solver} failed on {cloth} ({result.get('failure')}); give a cell that finished")
    if fabric not in (None, cloth):
        raise ExportError(f"{folder} is a cell of {cloth!r}, not of {fabric!r}; leave out --fabric")
    try:
        found, causes = read_stiffness(result), recorded_settings(result)["causes"]
    except ValueError as error:
        raise ExportError(f"{path} is damaged: {error}; {_REMEDY}") from error
    if found is None:
        raise ExportError(
            f"{folder} has no stiffness: its solver ({solver}) predicts drapes without simulating a cloth; give a cell "
            "of a solver that fits stiffness, such as homo"
        )
    weight = density_of_cell(folder)
    known = labelled(solver, causes)
    material = FabricMaterial(cloth, known, f"cell {folder.name}", weight, found.bending, found.stretch, found.curve)
    return material if density is None else material.weighing(density)


def _of_document(path: Path, fabric: str | None, density: float | None) -> FabricMaterial:
    chosen = _fabric(IdentifyDocument.read(path), fabric, path)
    if chosen.fit is None:
        why = chosen.fit_missing or "no reason recorded"
        remedy = "; repeat `cusick-bench identify` with its weight" if why.startswith(UNWEIGHED) else ""
        raise ExportError(f"{path} has no stiffness of {chosen.fabric}: {why}{remedy}")
    weight = density if chosen.areal_density is None else chosen.areal_density
    if weight is None:
        raise ExportError(f"{path} does not know the areal density of {chosen.fabric}; give it by --density [kg/m2]")
    bending, stretch = (
        {name: Quantity(one.value, one.ci90) for name, one in values.items()}
        for values in (chosen.fit.stiffness, chosen.fit.stretch)
    )
    found = FabricMaterial(chosen.fabric, chosen.fit.solver, path.name, weight, bending, stretch)
    return found if density is None else found.weighing(density)


def _fabric(document: IdentifyDocument, name: str | None, path: Path) -> FabricIdentity:
    """The fabric of this name; without a name the only one, or the only one that has a stiffness."""
    names = [one.fabric for one in document.fabrics]
    if name is not None:
        if name not in names:
            raise ExportError(f"{path} has no fabric {name!r}; use --fabric with one of {', '.join(names) or 'none'}")
        return document.fabrics[names.index(name)]
    fitted = [one for one in document.fabrics if one.fit is not None]
    candidates = fitted or list(document.fabrics)
    if not candidates:
        raise ExportError(f"{path} has no fabric; make it anew with `cusick-bench identify`")
    if len(candidates) > 1:
        some = ", ".join(one.fabric for one in candidates)
        raise ExportError(f"{path} has several fabrics; choose one with --fabric: {some}")
    return candidates[0]
