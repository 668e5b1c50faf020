"""Sentences of an identification: what is in doubt, and what to do next."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.audit.limits import UNMEASURED
from cusick_bench.datasets.files.layout import beside
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL
from cusick_bench.datasets.impossible import impossible, listed
from cusick_bench.datasets.index import UNNUMBERED
from cusick_bench.datasets.registry import registered_in
from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.diagnosis.options import LEAST_SAMPLES
from cusick_bench.files.first_names import first_names
from cusick_bench.files.shell_word import shell_word
from cusick_bench.identify.document import FAILED, NO_PHYSICS, UNUSABLE, UNWEIGHED, Drapes, Fit, Preparation
from cusick_bench.sim.constants import VERTICES_TO_FIT
from cusick_bench.solvers.registry import make_solver

if TYPE_CHECKING:
    import pandas as pd

USUAL_SAMPLES = 12  # number of samples in the public release, with two faces each, as the diagnosis was calibrated on
_MOST_ADVICE = 2  # largest number of measurements of the diagnosis' advice that are repeated here
_CLOSE = 0.03  # difference of drape coefficients by which samples of one cloth differ anyway
_LIMP = 0.5  # drape coefficient below which law plate on coarse meshes errs by more than samples differ
_FINE = 450  # vertices of a mesh on which it hardly does
_FACES_NEEDED = {
    "up": "where some are seen so, stiffness is learned from these alone",
    "down": "only samples that are seen from both faces tell their difference",
}
"""Why each face of a sample should be pictured where others of its fabric show both."""
_WIDE = 2.0  # ratio of the ends of an interval from which stiffness is called uncertain


def fit_notes(fit: Fit, samples: int, vertices: int) -> list[str]:
    """What is in doubt about a stiffness.

    Args:
        fit: The fit.
        samples: Samples of the fabric.
        vertices: Size of the mesh that it was fitted on.

    Returns:
        Sentences.
    """
    notes = []
    real, simulated = fit.drape_coefficient, fit.simulated_drape_coefficient
    if real is not None and simulated is not None and abs(simulated - real) > _CLOSE:
        notes.append(
            f"The fitted drape covers {100 * simulated:.0f} % of the overhang, the measured one {100 * real:.0f} %: "
            "the fit is rough. A larger --budget fits longer; a wrong weight, scale or picture leaves it rough."
        )
    if real is not None and real < _LIMP and vertices < _FINE:
        notes.append(
            f"A mesh of {vertices} vertices holds up cloth as limp as this (`cusick-bench mesh-error`), so that it is "
            f"found too limp; leave out --vertices, or take {VERTICES_TO_FIT} of them."
        )
    if fit.samples > 1:
        notes.append(
            f"Stiffness and interval are what {_learned_from(fit, samples)} tell of the cloth together; the drape "
            f"shown is fitted to sample {fit.sample}, whose drape coefficient is the median."
        )
    elif samples > 1:
        drapes, tell = ("two drapes, both faces", "two drapes tell") if fit.turned else ("one drape", "one drape tells")
        notes.append(
            f"Stiffness is that of {drapes}, of sample {fit.sample}, whose drape coefficient is the median; the "
            f"interval says how far {tell} the cloth's stiffness."
        )
    else:
        notes.append("Stiffness is from the only sample; another piece of the cloth may be stiffer or limper.")
    if not fit.finished:
        inferred = make_solver(fit.solver).drapes_of_inference
        known = inferred is not None and fit.drapes > inferred  # the last drape is that of the answer
        better = "fit the drape shown more closely; the interval stays" if known else "sharpen interval and fit"
        notes.append(f"The solver used up its budget of {fit.drapes:.0f} drapes; a larger --budget may {better}.")
    wide = [name for name, one in fit.stiffness.items() if one.ci90 is not None and one.ci90[1] > _WIDE * one.ci90[0]]
    if wide:
        notes.append(f"The interval of {', '.join(wide)} spans more than a factor of {_WIDE:g}.")
    if any(one.ci90 is None for one in fit.stiffness.values()):
        notes.append(f"{fit.solver} has no posterior, so there is no interval; bdp-field has one.")
    return notes


def _learned_from(fit: Fit, samples: int) -> str:
    """The samples behind a stiffness, of all samples of the fabric, with the faces that they show."""
    used = f"{fit.samples} samples" if fit.samples == samples else f"{fit.samples} of {samples} samples"
    if 0 < fit.turned < fit.samples:
        return f"{used} and the other face of {fit.turned} of them"
    return f"{'both faces of ' if fit.turned else ''}{used}"


def left_out_notes(dataset: DrapeDataset, fabric: str) -> list[str]:
    """Which pictures of a fabric can be measured, but show no cloth on its plate, so that no fit learns from them.

    Args:
        dataset: The data set.
        fabric: Name of the fabric.

    Returns:
        One sentence; none where all pictures that can be measured show cloth on its plate.
    """
    faults = impossible(dataset, [row for row, cloth in enumerate(dataset.table["cloth"]) if cloth == fabric])
    unmeasured = {fault.path for fault in faults if fault.kind in UNMEASURED}
    first = {fault.path: fault for fault in reversed(faults) if fault.path not in unmeasured}
    if not first:
        return []
    them, are = ("it", "picture shows") if len(first) == 1 else ("them", "pictures show")
    return [
        f"{len(first)} {are} no cloth on its plate, and no stiffness is learned from {them}, though drape coefficient "
        f"and folds count {them}: {listed(sorted(first.values()))}. Mend or remove {them}."
    ]


def _fit_advice(dataset: DrapeDataset, own: pd.DataFrame, fabric: str, fit_missing: str) -> list[str]:
    """What to do where there is no stiffness."""
    if fit_missing.startswith(UNWEIGHED):
        number, line = int(own["fabric"].iloc[0]), f"a line {dataset.fabrics[fabric]},0.18, in fabrics.csv"
        given = f'for photographs --weight "{number}=180 g/m2", in a data set {line}' if number else line
        return [f"Weigh the cloth (a sample's mass over its area) and repeat the command with the weight: {given}."]
    if fit_missing.startswith(FAILED):
        return [
            "Repeat the command with another --seed or more --vertices, by which all fabrics are fitted again; with "
            f"--cloth {shell_word(fabric)} and an --out of its own, this one alone."
        ]
    if NO_PHYSICS in fit_missing:
        return ["Repeat the command with a solver that simulates drapes, such as --solver bdp-field."]
    if fit_missing and not fit_missing.startswith(UNUSABLE):  # which the advice on unusable pictures is about
        return ["Mend what the reason above names, or use the pictures as they are with --force."]
    return []


def _sample_advice(dataset: DrapeDataset, own: pd.DataFrame) -> list[str]:
    """How many more samples a diagnosis needs; none where it refuses their size (`laboratory_next`)."""
    if not dataset.protocol.has_standard_ratio:
        return []
    more = LEAST_SAMPLES - len(set(own["sample"]))  # those of unusable pictures are cut already
    if more <= 0:
        return []
    return [
        f"Cut {more} more sample{'s' * (more != 1)} at least (the public release has {USUAL_SAMPLES}) and picture "
        "each: then the scatter between samples is known, and a diagnosis is possible."
    ]


def _face_advice(own: pd.DataFrame) -> list[str]:
    """What is missing to compare the two faces."""
    sides = set(own["side"])
    if any(UNNUMBERED in note for note in own["notes"]):
        return ["Number the captures in the names of the pictures (..._Capture_1): by it their face is known."]
    if "" in sides:
        return ["Say which face lies up in which capture (captures in protocol.json, --captures for photographs)."]
    if sides != {"up", "down"}:
        return ["Picture each sample with the other face up as well: a difference of the faces shows then."]
    return [
        f"Picture sample{'s' * (len(lacking) > 1)} {first_names(lacking)} face {side} as well: {why}."
        for side, why in _FACES_NEEDED.items()
        if (lacking := _samples_without(own, side))
    ]


def _samples_without(own: pd.DataFrame, side: str) -> list[str]:
    """Numbers of the samples of which no picture shows a face."""
    shown = set(own["sample"][own["side"] == side])
    return [str(sample) for sample in dict.fromkeys(own["sample"]) if sample not in shown]


def fabric_next(
    dataset: DrapeDataset,
    fabric: str,
    drapes: Drapes,
    fit_missing: str,
    diagnosis: DiagnosisDocument | None,
    refused: int,
) -> list[str]:
    """What to do next about one fabric.

    Args:
        dataset: The data set.
        fabric: Name of the fabric.
        drapes: What its silhouettes show.
        fit_missing: Why there is no stiffness; "" where there is one.
        diagnosis: The diagnosis; None where there is none.
        refused: Photographs of it that were refused.

    Returns:
        Sentences, the most urgent first.
    """
    own = dataset.select(cloth=fabric).table
    todo = []
    if refused:
        todo.append(
            f"Take {refused} photograph{'s' * (refused != 1)} again: {'its' if refused == 1 else 'their'} outline is "
            "not sure enough (see the list under The laboratory, and the pictures in data/check)."
        )
    if drapes.unusable:
        place = shell_word(dataset.root)
        todo.append(f"Look at {drapes.unusable} unusable pictures: cusick-bench data audit {place}")
    todo += _fit_advice(dataset, own, fabric, fit_missing) + _sample_advice(dataset, own) + _face_advice(own)
    if diagnosis is not None:
        todo += [f"{one.name}: {one.what}" for one in diagnosis.next[:_MOST_ADVICE]]
        todo += [f"Simulate this cloth with --with-effect {one}" for one in diagnosis.with_effect]
    return todo


def laboratory_next(dataset: DrapeDataset, preparation: Preparation | None) -> list[str]:
    """What to do next about the laboratory as a whole.

    Args:
        dataset: The data set.
        preparation: How photographs became the data set; None where they did not.

    Returns:
        Sentences.
    """
    todo, protocol, table = [], dataset.protocol, dataset.table
    shown = set(table["fabric"])  # 0 for all named sets
    lost = sorted({one.fabric for one in preparation.refused if one.fabric not in shown} if preparation else ())
    todo += [f"Take all photographs of fabric {number} again: none of them has a sure outline." for number in lost]
    if preparation is not None and preparation.camera_height_m is None:
        todo.append(
            "Measure the camera's height above the plate (--camera-height), or photograph the printed board held at "
            "two or more angles: perspective stays in the silhouettes as long as the height is not known."
        )
    if preparation is not None and preparation.calibration.startswith("the bare plate"):
        todo.append(
            "Print the board (cusick-bench data board) and photograph it on the plate: the bare plate alone does not "
            "tell a tilt of the camera."
        )
    if registered_in(dataset.root) is None and beside(dataset.root, PROTOCOL) is None:
        todo.append(
            f"Write {PROTOCOL} beside the data unless your sizes and scale are those of the public release "
            f"({protocol.sizes_text}), which are taken without it; docs/drape-meter.md says how."
        )
    if not protocol.has_standard_ratio:
        todo.append(
            f"For a diagnosis drape samples of {2e3 * protocol.standard_cloth_radius_m:.0f} mm over this plate: it "
            "knows only the ratio of 18 to 30 cm. Stiffness does not need them."
        )
    if len(set(dataset.fabrics.values())) == 1:
        todo.append(
            "Picture other fabrics on the same bench: what all of them show belongs to the bench, not the cloth."
        )
    return todo
