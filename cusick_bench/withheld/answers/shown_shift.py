"""The shift that a case's silhouettes show, from a comparison with its twin: the same case without its effect.

Severities of a suite are multiples of those that are detectable by the package's own laws. The true world has other
laws, so an effect may show less or more there. With w the whitened residual of a diagnosis, the shown shift is

    d = w(case) - w(twin),   |d|^2 = min(|d at the twin's base parameters|^2, |d at each's own|^2) - noise^2

in standard deviations of a fabric's own scatter, after the base parameters have explained what they can. Both have the
same random numbers, but a drape may fall into other folds; how much of d is due to that is estimated from the two
halves of the samples:  noise^2 = |d(first half) - d(second half)|^2 / 4.

Where several effects act, each also has a twin that lacks only this one, which gives the shift that it adds.

No diagnosis of the same statistics can find an effect that does not show, or call an effect unknown if up to three
other effects together, at the strengths that fit best, leave nothing of d (matching pursuit). The remaining randomness
of d is that of the same samples that are answered: where it helps to find an effect, it also enlarges d. Twins need the
suite's seed, so they are made after the answers.

References:
    Pati, Rezaiifar, Krishnaprasad. Orthogonal matching pursuit. Asilomar Conference on Signals, Systems and Computers,
    1993.
"""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from pydantic import Field, TypeAdapter, model_validator
from pydantic.dataclasses import dataclass
from scipy.optimize import nnls

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.inference.detectability.power import NEEDED
from cusick_bench.diagnosis.inference.residuals.noise import scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base, feature_vector, inflated
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics, sample_statistics, to_atlas
from cusick_bench.diagnosis.inference.single_effects.evidence import Grid, grid_at
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses
from cusick_bench.files.digest import file_digest
from cusick_bench.runner.processes import one_thread
from cusick_bench.runner.store import write_atomically
from cusick_bench.withheld import NUMERICS_VERSION
from cusick_bench.withheld.answers.blind import case_captures
from cusick_bench.withheld.answers.parts import case_part, gather, require_labels_of, require_unchanged
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.checked_json import read_object, validated
from cusick_bench.withheld.format.fields import Number, broken_rule
from cusick_bench.withheld.format.label import LabelDocument
from cusick_bench.withheld.suite.design import Plan
from cusick_bench.withheld.suite.generate import Suite, require_own_code, write_case
from cusick_bench.withheld.suite.labels import label_of


@dataclass(frozen=True)
class ShownShift:
    """Shift that the silhouettes of a case show; an entry of `twins.json`.

    Attributes:
        shift: |d|, in standard deviations of noise.
        nearest: The listed effect, not acting here, whose shift points most nearly where d does; "" if there is none.
        alike: The cosine between these, at most 1.
        left: What is left of |d| by other listed effects together.
        each: Where several effects act, |d| of each beside the others, by its name.
    """

    shift: Number
    nearest: str
    alike: Number
    left: Number
    each: dict[str, Number] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_ranges(self) -> "ShownShift":
        if not (min(self.shift, self.left, *self.each.values(), 0.0) >= 0 and self.alike <= 1):
            raise broken_rule(
                f"shift and left must be >= 0 and alike <= 1, got {self.shift:g}, {self.left:g} and {self.alike:g}; "
                "make the file anew"
            )
        return self

    @property
    def multiple(self) -> float:
        """The shift in detectable ones, of which an effect is found in 80 % of fabrics at the level of 5 %.

        Of several effects, that of the one which shows least.
        """
        return min(self.each.values(), default=self.shift) / NEEDED

    @property
    def unlike(self) -> float:
        """Remainder of the shift after other listed effects are subtracted, in detectable shifts."""
        return self.left / NEEDED


_MOST_MIMICS = 3  # listed effects that may stand together for another one
_SHIFTS = TypeAdapter(dict[str, ShownShift])


def measure_shown_shifts(
    suite: Suite,
    cases: Path,
    labels: Mapping[str, LabelDocument],
    out: Path,
    atlas: Path,
    *,
    workers: int = 1,
    step: Callable[[str], None] = lambda case: None,
) -> dict[str, ShownShift]:
    """Measures what every case with an effect shows of it, or resumes an interrupted run.

    Args:
        suite: The suite as it was generated.
        cases: Folder of its cases.
        labels: Content of its labels.json.
        out: File for what is measured, by case; what is measured of single cases lies beside it.
        atlas: Fitted atlas.
        workers: Number of processes.
        step: Called with the name of every case that is done.

    Returns:
        What each case shows.

    Raises:
        WithheldError: Labels or cases of another suite, cases by other code, or a twin that cannot be draped.
    """
    files, atlas_sha256 = require_labels_of(cases, labels), file_digest(atlas)
    todo = [plan for plan in suite.plans() if plan.causes and (cases / plan.case).is_dir()]
    for plan in todo:
        if plan.case not in labels or labels[plan.case].unsealed() != label_of(plan).content():
            raise WithheldError(f"{plan.case} has another label than its suite; give labels.json and suite.json of one")
    plans = {plan.case: plan for plan in todo}
    parts = {case: _part(out, files[case], suite, plan, atlas) for case, plan in plans.items()}
    if not all(part.exists() for part in parts.values()):
        require_own_code(suite, cases)
    return gather(
        out, parts, lambda case: (_beside_twin, suite, plans[case], cases, atlas),
        read=read_shown_shifts, write=_write, workers=workers, step=step,
        check=lambda case: require_unchanged(cases / case, files[case], atlas, atlas_sha256),
    )  # fmt: skip


def _part(out: Path, files: str, suite: Suite, plan: Plan, atlas: Path) -> Path:
    """Path of the file with the shown shift of one case."""
    return case_part(out, plan.case, files, atlas, suite, plan, f"withheld {NUMERICS_VERSION}")


def _write(path: Path, shifts: dict[str, ShownShift]) -> None:
    content = _SHIFTS.dump_python(dict(sorted(shifts.items())))
    write_atomically(path, json.dumps(content, indent=1).encode())


def read_shown_shifts(path: Path) -> dict[str, ShownShift]:
    """Reads what `measure_shown_shifts` wrote.

    Args:
        path: The file.

    Returns:
        What each case shows.

    Raises:
        WithheldError: Not such a file.
    """
    return validated(_SHIFTS, read_object(path, "make it by `withheld twins`"), str(path))


def _beside_twin(suite: Suite, plan: Plan, cases: Path, atlas: Path) -> ShownShift:
    """Makes the twin of a case, and one for each of several effects, and compares the case with them."""
    case, acting = _data(cases / plan.case), tuple(plan.causes)
    whole = shown_shift(case, _twin(suite, plan, acting), atlas, acting)
    if len(acting) < 2:
        return whole
    each = {name: shown_shift(case, _twin(suite, plan, (name,)), atlas, acting).shift for name in acting}
    return replace(whole, each=each)


def _twin(suite: Suite, plan: Plan, lacking: Collection[str]) -> SampleStatistics:
    """Statistics of the case as it would be without some of its effects."""
    causes = {name: values for name, values in plan.causes.items() if name not in lacking}
    with TemporaryDirectory() as folder, one_thread():
        write_case(suite, replace(plan, causes=causes), Path(folder))
        return _data(Path(folder) / plan.case)


def _data(folder: Path) -> SampleStatistics:
    return sample_statistics(to_atlas(case_captures(folder))[0])


def shown_shift(case: SampleStatistics, twin: SampleStatistics, atlas: Path, acting: Collection[str]) -> ShownShift:
    """Measures what a case shows that its twin does not.

    Args:
        case: Statistics of its samples.
        twin: Statistics of the samples of its twin.
        atlas: Fitted atlas.
        acting: Effects of the case; no shift is compared with theirs.

    Returns:
        The shift, the other effect that is most like it, and what others leave of it together.
    """
    emulator, calibration = load_atlas(atlas)
    scatter = scatter_of(twin.specimens)
    plain = against_base(emulator, twin.features(), scatter=scatter, drift=twin.later)
    refit = against_base(emulator, case.features(), scatter=scatter, drift=case.later, start=plain.theta)
    residual = inflated(plain, calibration.inflation)
    shift = _difference(residual, case, twin)
    noise = 0.0
    if len(twin.specimens) > 1:
        halves = np.array_split(np.arange(len(twin.specimens)), 2)
        first, second = (_difference(residual, case, twin, half) for half in halves)
        noise = float(((first - second) ** 2).sum()) / 4
    refitted = float(((refit.white - plain.white) ** 2).sum()) / calibration.inflation**2
    size = float(np.sqrt(max(min(float(shift @ shift), refitted) - noise, 0.0)))
    directions = _directions_of_others(emulator, residual, acting) if size else {}
    cosines = {name: float((unit @ shift).max()) / size for name, unit in directions.items() if len(unit)}
    nearest = max(cosines, key=cosines.__getitem__, default="")
    left = float(np.sqrt(max(unmatched(shift, directions) - noise, 0.0)))
    if not cosines.get(nearest, 0.0) > 0:
        return ShownShift(shift=size, nearest="", alike=0.0, left=min(left, size))
    return ShownShift(shift=size, nearest=nearest, alike=min(cosines[nearest], 1.0), left=min(left, size))


def _directions_of_others(
    emulator: Emulator, residual: Residual, acting: Collection[str]
) -> dict[str, Float[ndarray, "points kept"]]:
    """Unit shifts of every effect that does not act, of all parameters that it may have, by name."""
    found: dict[str, list[ndarray]] = {}
    for one in hypotheses(emulator):  # of some effects there are several, one for each frame
        if one.name not in acting:
            found.setdefault(one.name, []).append(_directions(grid_at(emulator, one, residual)))
    return {name: np.vstack(directions) for name, directions in found.items()}


def _directions(grid: Grid) -> Float[ndarray, "points kept"]:
    """Unit shifts of one hypothesis, of all parameters that it may have."""
    moved = grid.shift[np.isfinite(grid.log_prior)]
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def unmatched(shift: Float[ndarray, " kept"], directions: Mapping[str, Float[ndarray, "points kept"]]) -> float:
    """Squares of d that the effects which fit it best, one after the other, leave.

    Args:
        shift: d.
        directions: By name of the effect, unit shifts of all parameters that it may have.

    Returns:
        What up to `_MOST_MIMICS` of them leave, none with a strength below 0.
    """
    matched, left = np.zeros((0, len(shift))), shift
    remaining = {name: unit for name, unit in directions.items() if len(unit)}
    for _ in range(min(_MOST_MIMICS, len(remaining))):
        along = {name: unit @ left for name, unit in remaining.items()}
        name = max(along, key=lambda one: along[one].max())
        matched = np.vstack([matched, remaining.pop(name)[along[name].argmax()]])
        left = shift - nnls(matched.T, shift)[0] @ matched
    return float(left @ left)


def _difference(
    residual: Residual, case: SampleStatistics, twin: SampleStatistics, chosen: ndarray | None = None
) -> Float[ndarray, "kept"]:
    """d at the twin's base parameters; rows that too few samples leave unknown are taken as alike."""
    moved = feature_vector(case.features(chosen), residual.sd) - feature_vector(twin.features(chosen), residual.sd)
    return residual.whiten(np.nan_to_num(moved)[None])[0]
