"""The whole procedure from a folder to the result; every part is kept, and made again only if its inputs change.

folder -> data set -> drape coefficient, folds -> stiffness of a typical drape -> diagnosis -> document and page
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import exp, isfinite
from pathlib import Path

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.stats import ClothStatistics, statistics
from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.diagnosis.options import SHIPPED
from cusick_bench.identify.comparison import compare
from cusick_bench.identify.data import as_data_set, place_of, require_same_folder
from cusick_bench.identify.diagnoses import Progress, diagnose_fabrics, fabric_folder
from cusick_bench.identify.document import (
    Diagnosed,
    Drapes,
    FabricIdentity,
    Fit,
    IdentifyDocument,
    Made,
    Preparation,
    Spread,
)
from cusick_bench.identify.fabric_table import fabric_table
from cusick_bench.identify.fits import plan_fits, run_fits
from cusick_bench.identify.options import Options
from cusick_bench.identify.page import write_page
from cusick_bench.identify.words import fabric_next, fit_notes, laboratory_next, left_out_notes
from cusick_bench.identify.workspace import Workspace
from cusick_bench.photographs.preparation.setting_text import SettingText
from cusick_bench.runner import Source, Watcher
from cusick_bench.runner.environment import version_text
from cusick_bench.runner.numerics import diagnosis_numerics
from cusick_bench.runner.source import load_afresh
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.solvers.registry import make_solver


@dataclass(frozen=True, eq=False)
class Identification:
    """A folder whose data are at hand; its methods are the steps that follow.

    Attributes:
        given: Folder or data set that was given.
        workspace: Where all parts are kept.
        options: How to identify.
        source: Where the data come from.
        dataset: The data.
        cloths: Cloths to identify.
        preparation: How photographs became the data set; None where a data set was given.
        atlas: Atlas of the diagnosis.
    """

    given: str
    workspace: Workspace
    options: Options
    source: Source
    dataset: DrapeDataset
    cloths: tuple[str, ...]
    preparation: Preparation | None
    atlas: Path = SHIPPED

    def measure(self, done: Callable[[str], None] = lambda cloth: None) -> dict[str, ClothStatistics]:
        """Measures what silhouettes show by themselves.

        Args:
            done: Called with the name of each cloth that is read.

        Returns:
            Statistics by cloth.
        """
        return {one.cloth: one for one in statistics(self.dataset, self.cloths, progress=done)}

    def fit(
        self, watcher: Watcher | None = None, workers: int = 1, command: Sequence[str] = ()
    ) -> tuple[dict[str, Fit], dict[str, str]]:
        """Fits the stiffness of every fabric that can be fitted.

        Args:
            watcher: Told of the fits' progress.
            workers: Number of processes.
            command: Command line, for the record.

        Returns:
            Fits by cloth, and for each cloth without one the reason.
        """
        chosen = plan_fits(self.dataset, self.cloths, self.options)
        return run_fits(
            self.source, self.dataset, chosen, self.workspace, self.options,
            watcher=watcher, workers=workers, command=command,
        )  # fmt: skip

    def diagnose(
        self, progress: Progress = lambda what, share: None
    ) -> tuple[dict[str, DiagnosisDocument], dict[str, str]]:
        """Diagnoses every fabric that can be diagnosed.

        Args:
            progress: Called with what is being done and the share that is done.

        Returns:
            Documents by cloth, and for each cloth without one the reason.
        """
        return diagnose_fabrics(
            self.source.data, self.dataset, self.cloths, self.workspace, self.options, progress, self.atlas
        )

    def write(
        self,
        measured: Mapping[str, ClothStatistics],
        fits: tuple[Mapping[str, Fit], Mapping[str, str]],
        diagnoses: tuple[Mapping[str, DiagnosisDocument], Mapping[str, str]],
        command: str,
    ) -> IdentifyDocument:
        """Writes the document, the table and the page.

        Args:
            measured: From `measure`.
            fits: From `fit`.
            diagnoses: From `diagnose`.
            command: Command that makes the document again.

        Returns:
            The document.
        """
        protocol = self.dataset.protocol
        document = IdentifyDocument(
            folder=str(place_of(self.given)),
            data=str(self.dataset.root),
            dataset_hash=self.dataset.content_hash,
            preparation=self.preparation,
            cloth_radius_m=protocol.cloth_radius_m,
            plate_radius_m=protocol.plate_radius_m,
            fabrics=tuple(self._fabric(name, measured[name], fits, diagnoses) for name in self.cloths),
            next=tuple(laboratory_next(self.dataset, self.preparation)),
            made=Made(
                command=command,
                version=version_text(diagnosis_numerics(diagnosis=NUMERICS_VERSION)),
                options={name: list(value) if isinstance(value, tuple) else value
                         for name, value in asdict(self.options).items()},
            ),
        )  # fmt: skip
        document.write(self.workspace.document)
        write_atomically(self.workspace.table, fabric_table(document).encode())
        write_page(document, self.dataset, diagnoses[0], self.workspace)
        return document

    def _fabric(
        self,
        name: str,
        measured: ClothStatistics,
        fits: tuple[Mapping[str, Fit], Mapping[str, str]],
        diagnoses: tuple[Mapping[str, DiagnosisDocument], Mapping[str, str]],
    ) -> FabricIdentity:
        own = self.dataset.select(cloth=name).table.iloc[0].to_dict()
        density = float(own["areal_density"])
        weight = density if isfinite(density) and density > 0 else None
        drapes, fit, document = _drapes(measured), fits[0].get(name), diagnoses[0].get(name)
        folder = fabric_folder(self.workspace, self.dataset, name)
        diagnosis = None if document is None else _diagnosed(document, folder, self.workspace)
        fit_missing = fits[1].get(name, "")
        notes = fit_notes(fit, drapes.samples, self.options.vertices) if fit else []
        if fit and not self.options.force:
            notes += left_out_notes(self.dataset, name)
        shown = self.preparation.refused if self.preparation else ()
        refused = sum(one.fabric == int(own["fabric"]) for one in shown)
        return FabricIdentity(
            fabric=name,
            areal_density=weight,
            drapes=drapes,
            fit=fit,
            fit_missing=fit_missing,
            comparison=compare(weight, fit, diagnosis.bending if diagnosis else None),
            diagnosis=diagnosis,
            diagnosis_missing=diagnoses[1].get(name, ""),
            notes=tuple(notes),
            next=tuple(fabric_next(self.dataset, name, drapes, fit_missing, document, refused)),
        )


def begin(
    given: str,
    out: Path,
    options: Options,
    text: SettingText | None = None,
    image_size: int = 512,
    *,
    atlas: Path = SHIPPED,
    photographs: Callable[[int], None] = lambda count: None,
    prepared: Callable[[str], None] = lambda name: None,
) -> Identification:
    """Makes a folder's data ready; photographs become a data set in the workspace.

    Args:
        given: Folder of photographs, folder of a data set, or name of a data set.
        out: Workspace.
        options: How to identify.
        text: What one tells of photographs.
        image_size: Width of the silhouettes that photographs become [px].
        atlas: Atlas of the diagnosis.
        photographs: Called with the number of photographs, where some are going to be read.
        prepared: Called with the name of each that is finished.

    Returns:
        The identification, whose steps follow.

    Raises:
        CusickError: The folder is neither, a picture or table cannot be used, a cloth, solver or atlas is not there,
            there are too few vertices, or the workspace holds the answer about another folder.
    """
    workspace = Workspace(out)
    make_solver(options.solver)  # a wrong command line is told before anything is written
    cloth_mesh("plate", options.vertices)
    load_atlas(atlas)
    require_same_folder(given, workspace)
    data, preparation = as_data_set(given, workspace, text or SettingText(), image_size, photographs, prepared)
    source = Source(data)
    dataset = load_afresh(source)
    unknown = [name for name in options.cloths if name not in dataset.cloths]
    if unknown:
        raise DataError(f"unknown cloth {', '.join(unknown)}", remedy=f"use one of {', '.join(dataset.cloths)}")
    workspace.prepare()
    cloths = tuple(dict.fromkeys(options.cloths)) or tuple(dataset.cloths)
    return Identification(given, workspace, options, source, dataset, cloths, preparation, atlas)


def _drapes(measured: ClothStatistics) -> Drapes:
    return Drapes(
        samples=measured.samples,
        silhouettes=measured.silhouettes,
        units=measured.units,
        unusable=measured.unusable,
        drape_coefficient=_spread(measured.drape_coefficient, measured.drape_coefficient_sd),
        folds=_spread(measured.folds, measured.folds_sd),
        down_minus_up=_finite(measured.down_minus_up.mean),
    )


def _spread(mean: float, spread: float) -> Spread | None:
    return Spread(value=mean, sd=_finite(spread)) if isfinite(mean) else None


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _bending(document: DiagnosisDocument) -> float | None:
    """Bending stiffness of the base model of all samples [N m]."""
    level, data = document.base.bending, document.data
    if level is None or data.areal_density_kg_m2 is None:
        return None
    return exp(level) * data.areal_density_kg_m2 * data.gravity_m_s2 * data.cloth_radius_m**3


def _diagnosed(document: DiagnosisDocument, folder: Path, workspace: Workspace) -> Diagnosed:
    path = folder.relative_to(workspace.out).as_posix()
    return Diagnosed(
        verdict=document.verdict,
        headline=document.headline,
        effects=document.effects,
        p=document.gap.p,
        closure=document.closure.fraction,
        bending=_bending(document),
        path=f"{path}/diagnosis.json",
        page=f"{path}/diagnosis.html",
    )
