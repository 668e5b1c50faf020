"""One self-contained HTML page of an identification: overview, then each fabric's numbers and pictures."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.files import BadFile, read_json_object
from cusick_bench.identify.comparison_section import ComparisonSection, comparison_section
from cusick_bench.identify.document import FabricIdentity, Fit, IdentifyDocument, Preparation, Spread, Stiffness
from cusick_bench.identify.fits import typical_rows
from cusick_bench.identify.workspace import Workspace
from cusick_bench.leaderboard import significant
from cusick_bench.metrics.found_stiffness import read_stiffness
from cusick_bench.metrics.stiffness import GF_CM2_PER_CM
from cusick_bench.report.cell_view import load_cell_view
from cusick_bench.report.diagnosis.sections.causes import cause_section
from cusick_bench.report.diagnosis.sections.verdict import VerdictBox, verdict_box
from cusick_bench.report.diagnosis.wording.words import VERDICTS
from cusick_bench.report.drawing.pictures import drape_picture, silhouette_picture
from cusick_bench.report.drawing.stiffness_graph import StiffnessLine
from cusick_bench.report.errors import ReportError
from cusick_bench.report.page_template import render_page, write_html
from cusick_bench.report.run.content import (
    Card,
    Number,
    Picture,
    embedded_picture,
    fill_card,
    stiffness_picture,
    with_plate,
)
from cusick_bench.runner.store import RESULT_FILE

_MICRO = 1e6
_MOST_OTHERS = 48  # drapes of other samples whose range a graph shows
_NONE = "–"


@dataclass(frozen=True)
class FabricRow:
    """A fabric's line of the overview.

    Attributes:
        name: Name of the fabric.
        anchor: HTML id of the fabric's section, to which the line links.
        samples: Number of samples.
        drape_coefficient: Mean and spread.
        folds: Mean and spread.
        stiffness: Bending stiffness of warp, weft and bias, with intervals.
        verdict: Verdict of the diagnosis in words; a dash where there is none.
    """

    name: str
    anchor: str
    samples: int
    drape_coefficient: str
    folds: str
    stiffness: list[str]
    verdict: str


@dataclass(frozen=True)
class FabricSection:
    """A fabric's section.

    Attributes:
        row: Its line of the overview.
        numbers: The most important numbers.
        pictures: Silhouettes.
        drape: The fitted drape from the side; None without one.
        profile: Graph of radius over angle; None without a fit.
        others: Number of other samples behind the graph's band.
        stiffness: Graph of the posterior; None without a fit.
        truth: Whether that graph shows a true stiffness.
        fit_missing: Why there is no stiffness.
        comparison: Its stiffness among measured fabrics; None where there is none.
        verdict: Of the diagnosis; None where there is none.
        diagnosis_page: Its page, relative to this one.
        diagnosis_missing: Why there is none.
        notes: What is in doubt.
        next: What to do next.
    """

    row: FabricRow
    numbers: list[Number]
    pictures: tuple[Picture, ...]
    drape: Picture | None
    profile: Markup | None
    others: int
    stiffness: Markup | None
    truth: bool
    fit_missing: str
    comparison: ComparisonSection | None
    verdict: VerdictBox | None
    diagnosis_page: str
    diagnosis_missing: str
    notes: tuple[str, ...]
    next: tuple[str, ...]


@dataclass(frozen=True)
class IdentifyPage:
    """What the page holds.

    Attributes:
        title: Its title.
        summary: What was measured, in a sentence.
        fabrics: The fabrics.
        preparation: How photographs became silhouettes; None where they did not.
        camera: The same in a sentence.
        next: What to do next about the laboratory.
        facts: Name and value of what made the page.
    """

    title: str
    summary: str
    fabrics: list[FabricSection]
    preparation: Preparation | None
    camera: str
    next: tuple[str, ...]
    facts: list[tuple[str, str]]


def write_page(
    document: IdentifyDocument,
    dataset: DrapeDataset,
    diagnoses: Mapping[str, DiagnosisDocument],
    workspace: Workspace,
) -> Path:
    """Writes the page.

    Args:
        document: What was found.
        dataset: The data, whose silhouettes are shown.
        diagnoses: Documents of the diagnosis by fabric.
        workspace: Where the fits lie, and the page is written.

    Returns:
        The file written.
    """
    page = IdentifyPage(
        title=f"Fabrics of {Path(document.folder).name or document.folder}",
        summary=_summary(document),
        fabrics=[
            _section(number, fabric, dataset, diagnoses.get(fabric.fabric), workspace)
            for number, fabric in enumerate(document.fabrics)
        ],
        preparation=document.preparation,
        camera=_camera(document.preparation) if document.preparation else "",
        next=document.next,
        facts=[
            ("Data", f"{document.data} (sha256 {document.dataset_hash[:12]})"),
            ("Command", document.made.command),
            ("Version", document.made.version),
        ],
    )
    text = render_page("identify.html.j2", page=page)
    write_html(workspace.page, text)
    return workspace.page


def _summary(document: IdentifyDocument) -> str:
    count = len(document.fabrics)
    fitted = sum(one.fit is not None for one in document.fabrics)
    diagnosed = sum(one.diagnosis is not None for one in document.fabrics)
    sizes = f"{2e3 * document.cloth_radius_m:.0f} mm over a plate of {2e3 * document.plate_radius_m:.0f} mm"
    return (
        f"{count} fabric{'s' * (count != 1)}, cut to {sizes}: drape coefficient and folds of all, bending stiffness of "
        f"{fitted}, a diagnosis of {diagnosed}."
    )


def _camera(preparation: Preparation) -> str:
    used = preparation.photographs - len(preparation.refused)
    height = preparation.camera_height_m
    shown = "of unknown height" if height is None else f"{height:.2f} m above the plate"
    spread = "" if preparation.scale_sd is None else f", scale ± {100 * preparation.scale_sd:.2g} %"
    return (
        f"{used} of {preparation.photographs} photographs were used; the camera, {shown}, was calibrated from "
        f"{preparation.calibration}{spread}."
    )


def _section(
    number: int,
    fabric: FabricIdentity,
    dataset: DrapeDataset,
    diagnosis: DiagnosisDocument | None,
    workspace: Workspace,
) -> FabricSection:
    section = FabricSection(
        row=_row(number, fabric),
        numbers=_numbers(fabric),
        pictures=(),
        drape=None,
        profile=None,
        others=0,
        stiffness=None,
        truth=False,
        fit_missing=fabric.fit_missing,
        comparison=comparison_section(fabric.fabric, fabric.comparison, fabric.areal_density)
        if fabric.comparison and fabric.areal_density
        else None,
        verdict=None if diagnosis is None else verdict_box(diagnosis, cause_section(diagnosis)),
        diagnosis_page=fabric.diagnosis.page if fabric.diagnosis else "",
        diagnosis_missing=fabric.diagnosis_missing,
        notes=fabric.notes,
        next=fabric.next,
    )
    if fabric.fit is not None:
        return _with_fit(section, fabric.fabric, fabric.fit, dataset, workspace)
    return replace(section, pictures=_silhouette(dataset, fabric.fabric))


def _row(number: int, fabric: FabricIdentity) -> FabricRow:
    drapes, fit = fabric.drapes, fabric.fit
    return FabricRow(
        name=fabric.fabric,
        anchor=f"fabric-{number}",
        samples=drapes.samples,
        drape_coefficient=_spread(drapes.drape_coefficient, 1, 100.0),
        folds=_spread(drapes.folds, 1),
        stiffness=[_NONE] * 3 if fit is None else [_micro(fit.stiffness[name]) for name in ("warp", "weft", "bias")],
        verdict=_NONE if fabric.diagnosis is None else VERDICTS[fabric.diagnosis.verdict][0],
    )


def _spread(one: Spread | None, digits: int, factor: float = 1.0) -> str:
    if one is None:
        return _NONE
    spread = "" if one.sd is None else f" ± {factor * one.sd:.{digits}f}"
    return f"{factor * one.value:.{digits}f}{spread}"


def _micro(one: Stiffness) -> str:
    """Bending stiffness with its interval [µN m]."""
    bounds = "" if one.ci90 is None else f" [{', '.join(significant(_MICRO * bound) for bound in one.ci90)}]"
    return significant(_MICRO * one.value) + bounds


def _numbers(fabric: FabricIdentity) -> list[Number]:
    drapes, fit, row = fabric.drapes, fabric.fit, _row(0, fabric)
    units = f"{drapes.units} face{'s' * (drapes.units != 1)} of {drapes.samples} sample{'s' * (drapes.samples != 1)}"
    numbers = [
        Number(
            "drape coefficient", f"{row.drape_coefficient} %", f"mean ± sd of {units}" if drapes.units > 1 else units
        ),
        Number("folds", row.folds),
    ]
    if drapes.down_minus_up is not None:
        numbers.append(Number("face down − up", f"{100 * drapes.down_minus_up:+.1f} points", "of drape coefficient"))
    if fabric.areal_density is not None:
        numbers.append(Number("weight", f"{1e3 * fabric.areal_density:.0f} g/m²"))
    if fabric.diagnosis is not None and fabric.diagnosis.bending is not None:
        mean = f"{significant(_MICRO * fabric.diagnosis.bending)} µN m"
        numbers.append(Number("bending, all samples", mean, "mean of warp and weft, by the diagnosis; no interval"))
    if fit is None:
        return numbers
    for name, one in fit.stiffness.items():
        beside = f"{significant(one.value / GF_CM2_PER_CM)} gf cm²/cm"
        if one.ci90 is not None:
            low, high = (significant(_MICRO * bound) for bound in one.ci90)
            beside += f"; 90 %: {low} to {high}"
        numbers.append(Number(f"bending, {name}", f"{significant(_MICRO * one.value)} µN m", beside))
    return numbers


def _with_fit(
    section: FabricSection, cloth: str, fit: Fit, dataset: DrapeDataset, workspace: Workspace
) -> FabricSection:
    """The section with the pictures of its fit; with the silhouette alone where the fit's files cannot be read."""
    folder = workspace.out / fit.path
    try:
        view = load_cell_view(folder, dataset.protocol)
        found = read_stiffness(read_json_object(folder / RESULT_FILE, remedy=""))
    except (ReportError, BadFile, ValueError) as error:
        damaged = f"The pictures of the fit cannot be shown ({error}); remove {workspace.run} and repeat the command."
        return replace(section, pictures=_silhouette(dataset, cloth), notes=(*section.notes, damaged))
    others = _other_profiles(dataset, cloth, fit.sample)
    drape = drape_picture(view.vertices, view.faces, cloth, protocol=dataset.protocol)
    card = fill_card(Card("the fit", "solver", "", []), cloth, view, drape, others)
    real = replace(card.pictures[0], caption=f"Sample {fit.sample}, the most typical")
    return replace(
        section,
        pictures=(real, *card.pictures[1:]),
        drape=card.drape,
        profile=card.profile,
        others=card.band,
        truth=found is not None and found.true_bending is not None,
        stiffness=None
        if found is None
        else stiffness_picture(cloth, [StiffnessLine(fit.solver.partition(",")[0], found, view.bending_draws)]),
    )


def _silhouette(dataset: DrapeDataset, cloth: str) -> tuple[Picture, ...]:
    rows = typical_rows(dataset, cloth) or typical_rows(dataset, cloth, force=True)
    if not rows:
        return ()
    sample = int(np.asarray(dataset.table["sample"])[rows[0]])
    pixels = silhouette_picture(dataset.image(rows[0]).numpy())
    picture = embedded_picture(pixels, f"Silhouette of {cloth}", f"Sample {sample}, the most typical")
    return (with_plate(picture, dataset.protocol),)


def _other_profiles(dataset: DrapeDataset, cloth: str, sample: int) -> Float[ndarray, "samples angles"] | None:
    """Radii of a drape of each other sample, of the face that is fitted [m]; None where there is no other."""
    samples = np.asarray(dataset.table["sample"])
    rows = sorted(row for row in typical_rows(dataset, cloth) if samples[row] != sample)[:_MOST_OTHERS]
    return np.stack([dataset.sample(row).profile.radii for row in rows]) if rows else None
