"""`identify.csv`: a row for each fabric, for spreadsheets. `COLUMNS` says what each column is."""

from typing import Any

from pandas import DataFrame

from cusick_bench.files.csv_text import csv_text
from cusick_bench.identify.document import Compared, FabricIdentity, IdentifyDocument
from cusick_bench.metrics.stiffness import BENDING, GF_CM2_PER_CM

_PLAIN = {
    "fabric": "Name of the fabric",
    "areal_density_kg_m2": "Mass per area [kg/m2]",
    "samples": "Number of cut pieces",
    "silhouettes": "Number of pictures",
    "drape_coefficient": "Share of the overhang that the drape covers [1], mean over faces of samples",
    "drape_coefficient_sd": "Its standard deviation between faces of samples",
    "drape_coefficient_definition": "How it is defined, with the diameters of cloth and plate",
    "folds": "Number of folds, mean over faces of samples",
    "folds_sd": "Its standard deviation between faces of samples",
    "face_down_minus_up": "Difference of the drape coefficient between the faces [1]",
    "solver": "Who fitted the stiffness",
}
_NUMBERS = {
    "bending_{}_uN_m": "Bending stiffness [uN m], median of the posterior",
    "bending_{}_gf_cm2_cm": "The same [gf cm2/cm]",
    "bending_length_{}_cm": "Bending length (B / (g w))^(1/3) of ISO 9073-7 [cm]",
}
_RANK = "percent_of_similar_{}"
_END = {
    "bending_all_samples_uN_m": "Bending stiffness of all samples by the diagnosis, mean of warp and weft [uN m]",
    "fit_missing": "Why there is no stiffness",
    "verdict": "Of the diagnosis: none, effect, several, ambiguous, unknown or refused",
    "effects": "Effects that it names, the likeliest first, with a space between",
    "closure": "Share of the gap to the simulation that they close [1]",
    "diagnosis_missing": "Why there is no diagnosis",
}


def _columns() -> dict[str, str]:
    columns = dict(_PLAIN)
    for direction in BENDING:
        for name, what in _NUMBERS.items():
            columns[name.format(direction)] = f"{what}, {direction}"
            for bound, level in (("low", "5 %"), ("high", "95 %")):
                columns[f"{name.format(direction)}_{bound}"] = f"Its {level} quantile"
        columns[_RANK.format(direction)] = "Share of measured fabrics of similar weight that are less stiff [%]"
        for bound, level in (("low", "5 %"), ("high", "95 %")):
            columns[f"{_RANK.format(direction)}_{bound}"] = f"That share at the {level} quantile of the stiffness"
    return columns | _END


COLUMNS = _columns()
"""What each column is, with its unit; what is not known is empty."""


def fabric_table(document: IdentifyDocument) -> str:
    """The fabrics as CSV.

    Args:
        document: What was found.

    Returns:
        Content of the file.
    """
    definition = (
        f"(drape - plate) / (cloth - plate) of areas, ISO 9073-9, cloth {2e3 * document.cloth_radius_m:g} mm, plate "
        f"{2e3 * document.plate_radius_m:g} mm"
    )
    rows = [_row(fabric, definition) for fabric in document.fabrics]
    return csv_text(DataFrame(rows, columns=list(COLUMNS)))


def _row(fabric: FabricIdentity, definition: str) -> dict[str, Any]:
    drapes, fit, diagnosis = fabric.drapes, fabric.fit, fabric.diagnosis
    row: dict[str, Any] = {
        "fabric": fabric.fabric,
        "areal_density_kg_m2": fabric.areal_density,
        "samples": drapes.samples,
        "silhouettes": drapes.silhouettes,
        "drape_coefficient_definition": definition,
        "face_down_minus_up": drapes.down_minus_up,
        "fit_missing": fabric.fit_missing,
        "diagnosis_missing": fabric.diagnosis_missing,
    }
    for name, spread in (("drape_coefficient", drapes.drape_coefficient), ("folds", drapes.folds)):
        if spread is not None:
            row |= {name: spread.value, f"{name}_sd": spread.sd}
    if fit is not None:
        row["solver"] = fit.solver
    if diagnosis is not None:
        row |= {"verdict": diagnosis.verdict, "effects": " ".join(diagnosis.effects), "closure": diagnosis.closure}
    for one in fabric.comparison.numbers if fabric.comparison else ():
        row |= _numbers(one)
    return row


def _numbers(one: Compared) -> dict[str, Any]:
    """Cells of one number, in each of its units."""
    if one.direction == "mean":
        return {"bending_all_samples_uN_m": 1e6 * one.value} if one.quantity == "bending" else {}
    if one.quantity == "bending_length":
        return _bounded(f"bending_length_{one.direction}_cm", 100, one.value, one.ci90)
    return {
        **_bounded(f"bending_{one.direction}_uN_m", 1e6, one.value, one.ci90),
        **_bounded(f"bending_{one.direction}_gf_cm2_cm", 1 / GF_CM2_PER_CM, one.value, one.ci90),
        **_bounded(_RANK.format(one.direction), 1, one.among_similar.percent, one.among_similar.ci90),
    }


def _bounded(name: str, factor: float, value: float, ci90: tuple[float, float] | None) -> dict[str, float]:
    cells = {name: factor * value}
    if ci90 is not None:
        cells |= {f"{name}_low": factor * ci90[0], f"{name}_high": factor * ci90[1]}
    return cells
